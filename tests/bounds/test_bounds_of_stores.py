"""Bounds of worlds whose stores have limits: below the optimum, and withheld where unproven."""

import numpy as np
import pytest
from small_worlds import least_age_sum, small_world

from iout_marl import InputError, load_scenario
from iout_marl.bounds import bound, verified_age_sum
from iout_marl.bounds.check_game import is_covered
from iout_marl.world import World

#: Shares of the harvest of a slot in a node's cell: capacity, and what a slot loses.
STORES = {"small": (0.35, 0.0), "leaking": (2.0, 0.08), "both": (0.6, 0.03)}


def world(seed, store, duplex="fdd", initial=0.0, **options):
    scenario = small_world(np.random.default_rng(seed), duplex, slots=4, **options)
    harvest_j = float(World(scenario).link.harvested_w.max()) * scenario.slot_s
    capacity, lost = STORES[store]
    storage = {
        "kind": "capacitor",
        "capacity_j": capacity * harvest_j,
        "initial_j": initial * capacity * harvest_j,
        "leakage_w": lost * harvest_j / scenario.slot_s / 2,
        "idle_w": lost * harvest_j / scenario.slot_s / 2,
    }
    return scenario, load_scenario(scenario, {"storage": storage})


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("store", STORES)
def test_in_two_bands_both_stay_below_the_optimum_which_limits_only_raise(store, seed):
    unlimited, limited = world(seed, store)
    found, least = bound(limited, seconds=1), least_age_sum(limited)
    assert found.validity == "both bounds hold for every policy"
    assert found.scheduling <= found.energy_and_travel
    assert found.certificate.age_sum <= least
    assert found.best == bound(unlimited, seconds=1).best
    assert least_age_sum(unlimited) <= least


@pytest.mark.slow
def test_limits_do_raise_it():
    """So that the test above could fail."""
    raised = [
        least_age_sum(limited) > least_age_sum(unlimited)
        for unlimited, limited in (world(seed, store) for seed in range(3) for store in STORES)
    ]
    assert any(raised)


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"initial": 0.5}, "storage.initial_j gives nodes energy that they have not harvested"),
        (
            {"duplex": "tdd", "rule": "stored"},
            "a node whose store is full takes in energy where it would otherwise send",
        ),
    ],
)
def test_where_a_store_adds_something_the_second_one_is_withheld(options, why):
    unlimited, limited = world(1, "both", **options)
    found = bound(limited, seconds=0)
    assert found.energy_and_travel is None
    assert found.validity == (
        "the scheduling bound holds; for one by energy and travel stores would have to do nothing "
        f"but take possibilities away: {why}"
    )
    assert found.certificate.age_sum <= least_age_sum(limited)
    assert is_covered(unlimited)
    certificate = bound(unlimited, seconds=1).certificate
    with pytest.raises(InputError):
        verified_age_sum(limited, certificate)
