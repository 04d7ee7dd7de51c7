"""No bound exceeds the optimum of small worlds, found by playing every action."""

import numpy as np
import pytest
from small_worlds import least_age_sum, small_world

from iout_marl import evaluate
from iout_marl.bounds import bound

CASES = [
    ("fdd", "paper", "six", 2, 5),
    ("fdd", "paper", "hover", 2, 4),
    ("fdd", "paper", "six", 3, 4),
    ("tdd", "paper", "six", 2, 6),
    ("tdd", "paper", "hover", 3, 5),
    ("tdd", "stored", "six", 2, 6),
    ("tdd", "stored", "hover", 3, 5),
]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("duplex", "rule", "motion", "nodes", "slots"), CASES)
def test_bounds_stay_below_the_optimum(duplex, rule, motion, nodes, slots, seed):
    rng = np.random.default_rng([seed, nodes, slots, duplex == "tdd", rule == "stored"])
    scenario = small_world(rng, duplex, motion, nodes, slots, rule)
    optimum = least_age_sum(scenario)
    found = bound(scenario, seconds=1)
    node_slots = nodes * slots
    assert found.scheduling * node_slots <= optimum + 1e-9
    assert found.energy_and_travel * node_slots <= optimum + 1e-9
    planned = evaluate(scenario, "planner", episodes=1).metrics["mean_aoi"].mean
    assert planned * node_slots >= optimum - 1e-6
