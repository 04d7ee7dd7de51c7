"""The bound on mean AoI against every schedule there is, and against policies."""

import itertools

import numpy as np
import pytest

from iout_marl import evaluate, load_scenario
from iout_marl.bounds import delivery_bound


def scenario(auvs=1, nodes=3, slots=5, **changes):
    settings = {"auvs.count": auvs, "nodes.count": nodes, "episode.duration_s": 25 * slots}
    return load_scenario("paper/k10-fdd", settings | changes)


def best_of_all_schedules(auvs, nodes, slots, initial, maximum):
    """Least mean age over every way to reset up to `auvs` nodes in each slot."""
    ages = {(initial,) * nodes: 0}
    for _ in range(slots):
        after = {}
        for age, total in ages.items():
            for reset in itertools.combinations(range(nodes), min(auvs, nodes)):
                new = tuple(1 if k in reset else min(a + 1, maximum) for k, a in enumerate(age))
                key = tuple(sorted(new))
                after[key] = min(after.get(key, np.inf), total + sum(new))
        ages = after
    return min(ages.values()) / nodes / slots


@pytest.mark.parametrize("auvs", [1, 2, 3, 4])
@pytest.mark.parametrize("nodes", [1, 2, 3, 5])
@pytest.mark.parametrize("maximum", [3, 50])
def test_no_schedule_beats_it_and_one_reaches_it(auvs, nodes, maximum):
    for slots in (1, 2, 7):
        case = scenario(auvs, nodes, slots, **{"age.maximum": maximum, "age.initial": 2})
        least = best_of_all_schedules(auvs, nodes, slots, 2, maximum)
        assert delivery_bound(case) == pytest.approx(least, rel=1e-12)


def test_one_uplink_a_slot_is_as_one_auv():
    exclusive = scenario(3, 5, 20, **{"channel.access": "exclusive"})
    assert delivery_bound(exclusive) == delivery_bound(scenario(1, 5, 20))
    assert delivery_bound(scenario(3, 5, 20)) < delivery_bound(exclusive)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper/k3-fdd", "paper/k5-tdd", "multi/m4-k10-fdd"])
@pytest.mark.parametrize("policy", ["greedy", "round-robin", "random-walk"])
def test_policies_stay_above_it(name, policy):
    played = evaluate(name, policy, episodes=5)
    assert (played.samples["mean_aoi"] >= delivery_bound(load_scenario(name))).all()
