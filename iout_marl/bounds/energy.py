"""Stored energy in levels, rounded so that a node is never poorer than in the world.

See `iout_marl.core.levels`, and the duplex parts for what a slot does to a level.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from iout_marl.core.levels import EnergyLevels, Tables
from iout_marl.scenario import Scenario
from iout_marl.world import World, node_codes

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]


class LevelSpacing(NamedTuple):
    """How levels are spaced, in shares of the largest harvest of a slot."""

    step: float  # lowest levels: multiples of this,
    num_steps: int  # so many of them;
    wider_by: float  # from there each is the one below times this,
    top: float  # up to here; the last is without limit


#: Few levels, for bounds that list states of all nodes together.
COARSE = LevelSpacing(step=0.024, num_steps=15, wider_by=1.12, top=1.8)
#: Many, for bounds that take the nodes one by one.
FINE = LevelSpacing(step=0.012, num_steps=30, wider_by=1.08, top=3.0)
#: The fewest, to find one's way.
ROUGH = LevelSpacing(step=0.05, num_steps=7, wider_by=1.25, top=1.8)
#: Levels are made for no smaller harvest: they would be one and the same.
LEAST_J = 1e-200
#: Error allowed per slot for the world's floating-point sums, as a share of the energies.
ROUNDING = 1e-11


def energy_levels_j(spacing: LevelSpacing, largest_harvest_j: float) -> Floats:
    """(levels,) energies in J, from 0 to infinity."""
    # Any levels will do where nothing, or all but nothing, can be harvested.
    unit_j = max(largest_harvest_j, LEAST_J)
    levels = [i * spacing.step * unit_j for i in range(spacing.num_steps + 1)]
    while levels[-1] < spacing.top * unit_j:
        levels.append(levels[-1] * spacing.wider_by)
    return np.array([*levels, np.inf])


def make_tables(scenario: Scenario, levels_j: Floats, tolerance_j: float) -> Tables:
    """The tables of a scenario of one AUV and fixed nodes.

    Args:
        scenario: the scenario.
        levels_j: the levels, by `energy_levels_j`.
        tolerance_j: by how much the world's energies may exceed a level, see `tolerance_j`.
    """
    world = World(scenario)
    cells = world.grid.encode(world.grid.all_coordinates())
    nodes = node_codes(scenario, world.grid, [np.random.default_rng(0)])[0]
    offset = world.link.offset(cells[None, :], nodes[:, None])[..., None]
    return world.duplex.search_tables(EnergyLevels(levels_j, tolerance_j), offset)


def tolerance_j(scenario: Scenario, levels_j: Floats, largest_harvest_j: float) -> float:
    """What floating-point sums of a whole episode may add to an energy, in J; more than enough.

    A slot rounds a handful of times, each by a share of 2⁻⁵³ of energies of this size.
    """
    return scenario.num_slots * ROUNDING * (float(levels_j[-2]) + largest_harvest_j)
