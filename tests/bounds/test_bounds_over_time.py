"""Bounds of ages that are taken over time lie below the optimum, found by trying everything."""

import numpy as np
import pytest
from small_worlds import least_sum_over_time, small_world

from iout_marl import InputError, evaluate, load_scenario, parts
from iout_marl.bounds import bound, delivery_bound
from iout_marl.bounds.over_time import in_whole_slots, mean_in_whole_slots, mean_over_time

OVER_TIME = {"age.sampling": "packet_start"}
#: Duplex, rule, nodes, slots, further arguments.
CASES = {
    "fdd": ("fdd", "paper", 2, 5, {}),
    "fdd hover": ("fdd", "paper", 3, 3, {"motion": "hover"}),
    "tdd": ("tdd", "paper", 3, 5, {}),
    "tdd stored": ("tdd", "stored", 2, 6, {"motion": "hover"}),
    "modem": ("fdd", "modem", 2, 5, {}),
    "polling": ("fdd", "modem", 3, 4, {"polls": 2}),
    "two AUVs": ("tdd", "paper", 3, 2, {"auvs": 2}),
    "nobody": ("tdd", "airtime", 2, 5, {"idle_choices": True}),
}


def world(case, seed):
    duplex, rule, nodes, slots, more = CASES[case]
    rng, sizes = np.random.default_rng(seed), {"nodes": nodes, "slots": slots, "rule": rule}
    scenario = small_world(rng, duplex, **sizes, **more)
    return load_scenario(scenario, OVER_TIME)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("case", CASES)
def test_no_policy_is_below(case, seed):
    scenario = world(case, seed)
    optimum = least_sum_over_time(scenario) / scenario.num_nodes / scenario.num_slots
    found = bound(scenario, seconds=1)
    assert found.scheduling <= found.best <= optimum + 1e-9
    assert found.scheduling == delivery_bound(scenario)
    assert found.scenario_hash == scenario.hash
    assert found.certificate.world_hash == in_whole_slots(scenario).world_hash


@pytest.mark.slow
def test_is_not_far_below():
    """Where ages never reach their highest, x²/2 is lost and no more: here half of a slot."""
    gaps = []
    for seed in range(3):
        scenario = world("fdd", seed)
        optimum = least_sum_over_time(scenario) / scenario.num_nodes / scenario.num_slots
        gaps.append(optimum - bound(scenario, seconds=1).best)
    assert min(gaps) < 0.5


def test_is_near_what_a_policy_reaches_where_time_is_all_that_binds():
    changes = {"charging.power_w": 1e6, **OVER_TIME}
    scenario = load_scenario("paper/k3-fdd", changes)
    reached = evaluate(scenario, "tour", 1).metrics["mean_aoi"].mean
    assert 0 <= reached - delivery_bound(scenario) < 0.51


def test_there_and_back():
    scenario = load_scenario("paper/k3-fdd", OVER_TIME)
    assert mean_over_time(scenario, mean_in_whole_slots(scenario, 3.25)) == pytest.approx(3.25)
    assert in_whole_slots(scenario).num_slots == scenario.num_slots - 1


def test_of_one_slot_there_is_none():
    scenario = load_scenario("paper/k3-fdd", {**OVER_TIME, "episode.duration_s": 25})
    with pytest.raises(InputError, match="two slots and more"):
        bound(scenario, seconds=1)


@pytest.fixture
def short_packets():
    """A duplex part from outside whose packets take a tenth of the slot; its kind."""

    class Short(parts.duplexes["fdd"].item):
        """Packets at the end of the slot."""

        def split(self, charging_offset, uplink_offset, stored_j):
            split = super().split(charging_offset, uplink_offset, stored_j)
            return split._replace(uplink_s=split.uplink_s / 10)

    parts.duplexes.register("of_the_test", version=1)(Short)
    yield "of_the_test"
    parts.duplexes.unregister("of_the_test")


def test_parts_from_outside_are_not_taken_to_fill_the_slot(short_packets):
    changes = {"charging.power_w": 1e6, "duplex.kind": short_packets, **OVER_TIME}
    scenario = load_scenario("paper/k3-fdd", changes)
    reached = evaluate(scenario, "tour", 1).metrics["mean_aoi"].mean
    assert delivery_bound(scenario) <= reached
