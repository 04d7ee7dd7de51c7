"""A scenario of one AUV and fixed nodes as a finite game: cells, levels of energy, ages."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from iout_marl.bounds.energy import COARSE, LevelSpacing, energy_levels_j, make_tables, tolerance_j
from iout_marl.core.levels import Tables
from iout_marl.scenario import Scenario
from iout_marl.world import World, node_codes

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]


@dataclass(frozen=True)
class FiniteGame:
    """What the bounds by energy and travel need to know of a scenario.

    The game that it describes is never harder than the world: whatever a policy does there
    can be done here at no higher ages, see `energy`.

    Attributes:
        scenario: the scenario.
        levels_j: (levels,) the stored energies in J.
        tables: what a slot does to a node's level, (nodes, cells, levels).
        next_cells: (cells, choices) where an AUV can be a slot later.
        start: the cell in which the AUV starts.
        distance_m: (nodes, cells) distances in m.
    """

    scenario: Scenario
    levels_j: Floats
    tables: Tables
    next_cells: Integers
    start: int
    distance_m: Floats

    @classmethod
    def from_scenario(cls, scenario: Scenario, spacing: LevelSpacing = COARSE) -> FiniteGame:
        """The game of a scenario that `check_game.is_covered`, with energies on that spacing."""
        world = World(scenario)
        cells = world.grid.encode(world.grid.all_coordinates())
        index = np.zeros(world.grid.num_codes, dtype=np.int64)
        index[cells] = np.arange(len(cells))
        state = world.reset(node_codes(scenario, world.grid, [np.random.default_rng(0)]))
        offset = world.link.offset(cells[None, :], state.node_cell[0][:, None])
        harvest_j = float(world.link.at(world.link.harvested_w, offset).max()) * world.link.slot_s
        levels_j = energy_levels_j(spacing, harvest_j)
        return cls(
            scenario=scenario,
            levels_j=levels_j,
            tables=make_tables(scenario, levels_j, tolerance_j(scenario, levels_j, harvest_j)),
            next_cells=index[world.motion.next_cells(cells[:, None])[:, 0]],
            start=int(index[state.cell[0, 0]]),
            distance_m=world.link.at(world.link.distance_m, offset),
        )

    @property
    def num_levels(self) -> int:
        """Levels of stored energy."""
        return len(self.levels_j)
