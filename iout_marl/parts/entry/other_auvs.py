"""Where the other AUVs are."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from iout_marl.core.grid import Grid
from iout_marl.core.ranges import Ranges
from iout_marl.core.state import State
from iout_marl.parts.base import Context
from iout_marl.parts.entry.base import Entry, entries
from iout_marl.physics.arrays import Array, lookup
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import invalid


@entries.register("other_auvs")
class OtherAuvs(Entry):
    """Steps to each other AUV, from the nearest to the farthest.

    So what an AUV sees does not depend on how they are numbered.
    """

    unit = "cells"

    def check(self, scenario: Scenario) -> None:
        if scenario.num_auvs == 1:
            raise invalid(("observation", "entries"), "other_auvs: there is but one AUV")

    def setup(self, world: Context) -> None:
        super().setup(world)
        self._nearness = world.backend.integers(_nearness(world.grid))
        self._own = world.backend.integers(np.eye(world.scenario.num_auvs))

    @property
    def size(self) -> int:
        return 3 * (self.world.scenario.num_auvs - 1)

    def ranges(self) -> Ranges:
        one = self.world.representation.step_ranges()
        return Ranges.joined([one] * (self.world.scenario.num_auvs - 1))

    def others(self, cell: Array) -> Array:
        """Places of the other AUVs, the nearest first, among all of (envs, auvs) end to end.

        (envs, auvs, auvs − 1).
        """
        xp, link, (num_envs, num_auvs) = self.xp, self.world.link, cell.shape
        nearness = link.at(self._nearness, link.grid_offset(cell[:, None, :], cell[:, :, None]))
        # Each comes before those in its cell, and of these the one of lower number.
        order = xp.argsort(nearness - self._own, axis=-1, stable=True)[..., 1:]
        first = xp.arange(0, num_envs * num_auvs, num_auvs, device=cell.device)
        return first[:, None, None] + order

    def __call__(self, state: State) -> Array:
        xp, cell = self.xp, state.cell
        representation, (num_envs, num_auvs) = self.world.representation, cell.shape
        others = lookup(xp, cell, self.others(cell))
        steps = representation.in_cells(others) - representation.in_cells(cell)[:, :, None, :]
        return xp.reshape(representation.steps(steps), (num_envs, num_auvs, -1))


def _nearness(grid: Grid) -> npt.NDArray[np.int64]:
    """By code difference + origin: its rank among all, the shortest first, 0 for none."""
    order = np.argsort(grid.offset_distances_m(), kind="stable")
    # Differences that no two cells have are 0 long as well; the origin comes before them.
    order = np.concatenate([[grid.offset_origin], order[order != grid.offset_origin]])
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return rank
