"""Where AUVs can rest, and drift by what they could choose, currents add no possibility."""

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
    ("tdd", "stored", 2, 5),
]


def worlds(case, seed, *, with_battery):
    """A small world, and the same in a tide too strong for some moves, and at times to hold."""
    duplex, rule, nodes, slots = case
    rng = np.random.default_rng([seed, nodes, slots, duplex == "tdd", with_battery])
    scenario = small_world(rng, duplex, "hover", nodes, slots, rule)
    vehicle = {"kind": "unlimited", "max_speed_m_per_s": 4.3}
    if with_battery:
        move_j = 0.5 * 1025 * 0.018 * 4.0**3 / 0.7 * scenario.slot_s
        vehicle |= {
            "kind": "battery",
            "capacity_j": move_j * float(rng.uniform(1.5, 5)),
            "drag_area_m2": 3.0,
            "drag_coefficient": 0.006,
            "propulsion_efficiency": 0.7,
            "hotel_w": 40.0,
        }
    tide = {
        "kind": "tide",
        "speed_m_per_s": 4.9,
        "toward_deg": float(rng.integers(0, 360)),
        "period_h": 1.5 * slots * scenario.slot_s / 3600,
        "phase_deg": float(rng.integers(0, 360)),
    }
    return scenario, load_scenario(scenario, {"vehicle": vehicle, "current": tide})


@pytest.mark.parametrize("with_battery", [False, True], ids=["unlimited", "battery"])
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("case", CASES)
def test_the_bound_stays_below_the_optimum(case, seed, with_battery):
    still, flowing = worlds(case, seed, with_battery=with_battery)
    found = bound(flowing, seconds=1)
    assert found.validity == "both bounds hold for every policy"
    assert found.scheduling <= found.energy_and_travel
    node_slots = flowing.num_nodes * flowing.num_slots
    least, free = (
        least_age_sum(each)
        for each in (flowing, load_scenario(still, {"auvs.idle_choices": with_battery}))
    )
    assert found.energy_and_travel * node_slots <= free + 1e-9
    assert free <= least
