"""Bounds where moves take several slots, or cover several cells in one: below every optimum."""

import numpy as np
import pytest
from small_worlds import least_age_sum, small_world

from iout_marl import World, load_scenario
from iout_marl.bounds import bound


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("duplex", "motion", "share", "slots"),
    [
        ("fdd", "six", 0.5, 5),
        ("tdd", "hover", 0.4, 6),
        ("fdd", "six", 2.0, 4),
        ("tdd", "hover", 2.0, 5),
    ],
)
def test_bounds_stay_below_the_optimum(duplex, motion, share, slots, seed):
    plain = small_world(np.random.default_rng([seed, slots]), duplex, motion, 2, slots)
    slot_s = plain.slot_s * share
    changes = {"episode.slot_s": slot_s, "episode.duration_s": slots * slot_s}
    scenario = load_scenario(plain, changes)
    pace = World(scenario).motion.pace
    assert (pace.slots.max() > 1) == (share < 1)
    assert (pace.cells.max() > 1) == (share > 1)
    least, found = least_age_sum(scenario), bound(scenario, seconds=0.3)
    node_slots = scenario.num_nodes * scenario.num_slots
    assert found.scheduling <= found.energy_and_travel
    assert found.energy_and_travel * node_slots <= least + 1e-9
