"""What entries about steps from cell to cell have in common."""

from __future__ import annotations

import numpy as np

from iout_marl.core.ranges import Ranges
from iout_marl.parts.base import Context
from iout_marl.parts.entry.base import Entry
from iout_marl.physics.arrays import Array, lookup

#: Cells that count as 1: about as far as the paper's grid reaches.
CELLS = 10.0


class StepsTo(Entry):
    """Steps from one cell to another, in tens of cells: along x, y and z, and their length."""

    def setup(self, world: Context) -> None:
        super().setup(world)
        steps = world.grid.offset_steps()
        # Of whole numbers, so that equal lengths are equal to the last digit.
        lengths = np.sqrt((steps**2).sum(axis=1))
        columns = [column / CELLS for column in (*steps.T, lengths)]
        self._bounds = [(float(column.min()), float(column.max())) for column in columns]
        #: By difference of codes, see `Grid`.
        self._tables = [world.backend.floats(column) for column in columns]

    def ranges(self) -> Ranges:
        return by_column(self.size, self._bounds)

    def steps(self, cell: Array, other: Array) -> list[Array]:
        """x, y, z and length from cells to others, by codes that broadcast, in their shape."""
        offset = self.world.link.grid_offset(other, cell)
        return [lookup(self.xp, table, offset) for table in self._tables]


def by_column(size: int, bounds: list[tuple[float, float]]) -> Ranges:
    """Ranges of so many numbers, in columns of these least and largest ones.

    Of numbers that never change the largest is 1 more: spaces have some room in them.
    """
    times = size // len(bounds)
    low = np.repeat([float(least) for least, _ in bounds], times)
    high = np.repeat([float(most if most > least else least + 1) for least, most in bounds], times)
    return Ranges(low, high, np.ones(size))
