"""Pairs of cells of which a table holds one number each, where a distance does not say enough."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from iout_marl.core.grid import Floats, Grid

Integers = npt.NDArray[np.int64]

#: More pairs than tables have room for.
MAX_PAIRS = 4_000_000


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs of an AUV's cell and a node's, by an index; those that are alike share one.

    Attributes:
        grid: the grid.
        row, column: (codes,) each: the index of a pair is the row of the AUV's cell plus the
            column of the node's.
        auv_cells, node_cells: (pairs, 3) each: one pair of cells of every index, from 0.
    """

    grid: Grid
    row: Integers
    column: Integers
    auv_cells: Integers
    node_cells: Integers

    @classmethod
    def from_cells(cls, grid: Grid) -> Pairs:
        """Every pair of cells by itself."""
        coordinates, count = grid.all_coordinates(), grid.num_cells
        codes = grid.encode(coordinates)
        row, column = (np.zeros(grid.num_codes, dtype=np.int64) for _ in range(2))
        row[codes], column[codes] = np.arange(count) * count, np.arange(count)
        auv_cells = np.repeat(coordinates, count, axis=0)
        return cls(grid, row, column, auv_cells, np.tile(coordinates, (count, 1)))

    @classmethod
    def from_layers(cls, grid: Grid) -> Pairs:
        """Pairs of the same horizontal offset and the same two layers are alike."""
        x, y, z = grid.shape
        coordinates = grid.coordinate_table()
        # Differences of such codes tell horizontal offsets apart, as those of `Grid` do of cells.
        across = coordinates[:, 0] * (2 * y - 1) + coordinates[:, 1]
        origin = (x - 1) * (2 * y - 1) + y - 1
        row = (across + origin) * z**2 + coordinates[:, 2] * z
        column = coordinates[:, 2] - across * z**2
        shape = (2 * x - 1, 2 * y - 1, z, z)
        dx, dy, auv_layer, node_layer = np.unravel_index(np.arange(np.prod(shape)), shape)
        steps = np.stack([dx - (x - 1), dy - (y - 1)], axis=-1)
        auv_cells = np.column_stack([np.maximum(steps, 0), auv_layer])
        node_cells = np.column_stack([np.maximum(-steps, 0), node_layer])
        return cls(grid, row, column, auv_cells, node_cells)

    @staticmethod
    def count_of_cells(grid: Grid) -> int:
        """How many `from_cells` makes."""
        return grid.num_cells**2

    @staticmethod
    def count_of_layers(grid: Grid) -> int:
        """How many `from_layers` makes."""
        x, y, z = grid.shape
        return (2 * x - 1) * (2 * y - 1) * z**2

    @cached_property
    def way_m(self) -> Floats:
        """From centre to centre, (pairs,)."""
        return self.grid.metres(self.auv_cells - self.node_cells)

    @cached_property
    def range_m(self) -> Floats:
        """The same along the horizontal, (pairs,)."""
        return self.grid.metres((self.auv_cells - self.node_cells) * [1, 1, 0])
