"""Levels of energy: two derivations agree, and no node of the world is richer than its level."""

import numpy as np
import pytest
from small_worlds import small_world

from iout_marl.bounds.check_game import finite_game
from iout_marl.bounds.energy import COARSE, FINE
from iout_marl.bounds.finite_game import FiniteGame
from iout_marl.world import World, node_codes

RULES = [
    ("fdd", "paper"),
    ("tdd", "paper"),
    ("tdd", "stored"),
    ("fdd", "modem"),
    ("tdd", "airtime"),
]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("ladder", [COARSE, FINE])
@pytest.mark.parametrize(("duplex", "rule"), RULES)
def test_search_and_check_agree(duplex, rule, ladder, seed):
    scenario = small_world(np.random.default_rng(seed), duplex, "hover", 3, 6, rule)
    field = FiniteGame.from_scenario(scenario, ladder)
    game = finite_game(scenario, tuple(field.levels_j[:-1].tolist()))
    assert game.start == field.start
    np.testing.assert_array_equal(game.neighbours, field.next_cells)
    np.testing.assert_allclose(game.distance_m, field.distance_m)
    for number, table in enumerate(table for table in field.tables if table is not None):
        checked = [tables[number] for tables in game.tables]
        np.testing.assert_array_equal(checked, table)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("duplex", "rule"), RULES)
def test_the_world_is_never_richer_than_its_levels(duplex, rule, seed):
    rng = np.random.default_rng(seed)
    scenario = small_world(rng, duplex, "six", 3, 40, rule)
    field = FiniteGame.from_scenario(scenario, FINE)
    charge, deliver, both = field.tables
    cell_of = World(scenario).grid.encode(World(scenario).grid.all_coordinates()).tolist()
    world = World(scenario)
    state = world.reset(node_codes(scenario, world.grid, [rng]))
    levels = np.zeros(3, dtype=np.int64)
    for _ in range(scenario.num_slots):
        action = rng.integers(0, world.action_sizes)[None, None, :]
        state, events = world.step(state, action)
        cell = cell_of.index(int(state.cell[0, 0]))
        charged, heard = int(events.charged[0, 0]), int(events.heard[0, 0])
        delivered = bool(events.delivered[0, 0])
        if both is None:
            table = deliver if delivered else charge
            levels[heard] = table[heard, cell, levels[heard]]
        elif delivered and charged == heard:
            levels[heard] = both[heard, cell, levels[heard]]
        else:
            levels[charged] = charge[charged, cell, levels[charged]]
            if delivered:
                levels[heard] = deliver[heard, cell, levels[heard]]
        assert (levels < field.num_levels).all(), "the game forbids what the world does"
        assert (state.energy_j[0] <= field.levels_j[levels] + 1e-6).all()
