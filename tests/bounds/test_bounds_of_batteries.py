"""Where AUVs can rest, a battery takes possibilities away, and adds none."""

import numpy as np
import pytest
from small_worlds import least_age_sum, small_world

from iout_marl import load_scenario
from iout_marl.bounds import bound

pytestmark = pytest.mark.slow

CASES = [
    # duplex, rule for β, nodes, slots
    ("fdd", "paper", 2, 4),
    ("tdd", "paper", 1, 6),
    ("tdd", "stored", 1, 7),
    ("tdd", "stored", 2, 5),
]


def worlds(case, seed):
    """A small world, and the same with batteries that last for some of its slots."""
    duplex, rule, nodes, slots = case
    rng = np.random.default_rng([seed, nodes, slots, duplex == "tdd", rule == "stored"])
    scenario = small_world(rng, duplex, "hover", nodes, slots, rule)
    move_j = 0.5 * 1025 * 0.018 * 4.0**3 / 0.7 * scenario.slot_s
    vehicle = {
        "kind": "battery",
        "capacity_j": move_j * float(rng.uniform(1.1, 4)),
        "drag_area_m2": 3.0,
        "drag_coefficient": 0.006,
        "propulsion_efficiency": 0.7,
        "hotel_w": 40.0,
        "docks": [[1, 1, 1], [2, 2, 1]],
        "dock_power_w": 2000.0,
    }
    return scenario, load_scenario(scenario, {"vehicle": vehicle})


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("case", CASES)
def test_the_bound_stays_below_the_optimum(case, seed):
    plain, limited = worlds(case, seed)
    least = least_age_sum(limited)
    node_slots = limited.num_nodes * limited.num_slots
    found = bound(limited, seconds=1)
    assert found.validity == "both bounds hold for every policy"
    assert found.scheduling <= found.energy_and_travel
    assert found.energy_and_travel * node_slots <= least + 1e-9
    # With as much energy as one likes, and nobody among the choices, no less can be done.
    free = least_age_sum(load_scenario(plain, {"auvs.idle_choices": True}))
    assert free <= least
    assert found.energy_and_travel * node_slots <= free + 1e-9
