"""Bounds where AUVs poll: the scheduling bound counts every uplink of a slot, and stays true."""

import numpy as np
import pytest
from polling import polling
from small_worlds import least_age_sum, small_world

from iout_marl import InputError, load_scenario
from iout_marl.bounds import Certificate, bound, verified_age_sum
from iout_marl.bounds import least_age_sum as scheduled_age_sum
from iout_marl.bounds.check_game import is_covered
from iout_marl.bounds.scheduling import resets_per_slot

#: Duplex, rule, AUVs, nodes, slots, access, nodes polled: what is searched within a second or so.
CASES = [
    ("fdd", "modem", 1, 3, 4, "orthogonal", 2),
    ("fdd", "modem", 1, 3, 4, "orthogonal", 3),
    ("tdd", "airtime", 1, 3, 5, "orthogonal", 2),
    ("tdd", "airtime", 2, 3, 2, "orthogonal", 2),
    ("tdd", "airtime", 2, 3, 2, "exclusive", 2),
]
SEEDS = range(3)


def world(case, seed, polls=None):
    duplex, rule, auvs, nodes, slots, access, most = case
    rng = np.random.default_rng([seed, auvs, nodes, slots])
    scenario = small_world(
        rng, duplex, "hover", nodes, slots, rule, auvs, access, polls=polls or most
    )
    # Sound that reaches far, and stores that hold enough for some packets when it begins.
    more = {
        "uplink.maximum_source_level_db": 140.0,
        "uplink.packet_bits": 4000.0,
        "storage": {
            "kind": "capacitor",
            "capacity_j": 40.0,
            "initial_j": float(rng.uniform(4, 40)),
        },
        "duplex": {
            "kind": duplex,
            **({"beta_rule": rule, "beta_max": 0.5} if rule != "modem" else {}),
        },
    }
    return load_scenario(scenario, more)


@pytest.fixture(scope="module")
def optimum():
    known = {}

    def find(case, seed):
        if (case, seed) not in known:
            known[case, seed] = least_age_sum(world(case, seed))
        return known[case, seed]

    return find


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("case", CASES)
def test_the_scheduling_bound_stays_below_the_optimum(case, seed, optimum):
    scenario, least = world(case, seed), optimum(case, seed)
    found = bound(scenario, seconds=0)
    assert found.energy_and_travel is None
    assert found.validity.startswith("the scheduling bound holds; the one by energy and travel is")
    assert found.certificate.age_sum <= least
    assert verified_age_sum(scenario, found.certificate) == found.certificate.age_sum
    with pytest.raises(ValueError, match="scheduling proves no more than"):
        verified_age_sum(scenario, Certificate(scenario.world_hash, least + 1))


@pytest.mark.slow
def test_it_is_reached_and_that_of_one_uplink_a_slot_would_be_wrong(optimum):
    """Often, so that the test above could fail."""
    pairs = [(case, seed) for case in CASES for seed in SEEDS]
    reached = [scheduled_age_sum(world(*pair)) == optimum(*pair) for pair in pairs]
    one = {"hearing": "one"}
    wrong = [scheduled_age_sum(world(*p), overrides=one) > optimum(*p) for p in pairs]
    assert sum(reached) >= 3
    assert sum(wrong) >= 5


@pytest.mark.parametrize(
    ("most", "auvs", "access", "resets"),
    [
        (1, 1, "orthogonal", 1),
        (3, 1, "exclusive", 3),
        (2, 2, "orthogonal", 4),
        (2, 2, "exclusive", 2),
        (4, 2, "orthogonal", 5),
        (9, 1, "orthogonal", 5),
    ],
)
def test_uplinks_of_a_slot_are_those_of_the_parts(most, auvs, access, resets):
    changes = {"auvs.count": auvs, "channel.access": access}
    scenario = load_scenario("paper/k5-fdd", polling(most, **changes))
    assert resets_per_slot(scenario) == resets
    assert not is_covered(scenario)


def test_a_certificate_by_energy_and_travel_is_refused():
    scenario = load_scenario("paper/k5-fdd", polling(2))
    claim = Certificate(scenario.world_hash, scheduled_age_sum(scenario) + 1, (0.0, 1.0))
    with pytest.raises(InputError, match="energy and travel count for one AUV") as error:
        verified_age_sum(scenario, claim)
    assert "\n" not in str(error.value)
