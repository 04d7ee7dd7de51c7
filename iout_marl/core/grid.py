"""The grid of cells, and the codes by which the world names them.

A cell has one integer code, laid out so that the difference of two codes tells how far
apart the cells are in each direction. A table over code differences thus holds whatever
depends on where two cells lie to one another (distance, attenuation, …).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from iout_marl.scenario import Scenario

Floats: TypeAlias = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Grid:
    """A grid of `shape` cells along x, y and z, counted from 0 here, with edges of `edges_m`."""

    shape: tuple[int, int, int]
    edges_m: tuple[float, float, float] = (1.0, 1.0, 1.0)

    @classmethod
    def from_scenario(cls, scenario: Scenario) -> Grid:
        """The grid of a scenario."""
        return cls(scenario.grid.cells, scenario.grid.edges_m)

    @property
    def num_cells(self) -> int:
        x, y, z = self.shape
        return x * y * z

    @cached_property
    def strides(self) -> npt.NDArray[np.int64]:
        """Step of the code for one cell along x, y and z.

        An axis of n cells takes 2n − 1 values, for the differences −(n−1) … n−1: so no
        two different offsets have the same difference of codes.
        """
        _, y, z = self.shape
        return np.array([(2 * y - 1) * (2 * z - 1), 2 * z - 1, 1])

    @cached_property
    def num_codes(self) -> int:
        """One more than the highest code; codes between those of cells stay unused."""
        return int(self.encode(np.array(self.shape) - 1)) + 1

    @property
    def offset_origin(self) -> int:
        """The index, in a table over code differences, of the difference 0."""
        return self.num_codes - 1

    def encode(self, coordinates: npt.ArrayLike) -> npt.NDArray[np.int64]:
        """Codes, of shape (…), of cells given as (…, 3) coordinates from 0."""
        codes: npt.NDArray[np.int64] = np.asarray(coordinates, dtype=np.int64) @ self.strides
        return codes

    def all_coordinates(self) -> npt.NDArray[np.int64]:
        """Coordinates of every cell, (cells, 3), from 0."""
        return np.stack(np.unravel_index(np.arange(self.num_cells), self.shape), axis=-1)

    def coordinate_table(self) -> npt.NDArray[np.int64]:
        """Coordinates from 0 by code, (codes, 3)."""
        cells = self.all_coordinates()
        table = np.zeros((self.num_codes, 3), dtype=np.int64)
        table[self.encode(cells)] = cells
        return table

    def lengths(self, steps: npt.ArrayLike) -> Floats:
        """Lengths of (…, 3) differences in cells, as multiples of the shortest edge: (…).

        In cubic cells they are those in cells, whatever the edge, to the last bit.
        """
        lengths: Floats = np.linalg.norm(np.asarray(steps) * self._relative_edges, axis=-1)
        return lengths

    def metres(self, steps: npt.ArrayLike) -> Floats:
        """Lengths of (…, 3) differences in cells, in m: (…)."""
        return self.lengths(steps) * min(self.edges_m)

    def offset_steps(self) -> npt.NDArray[np.int64]:
        """Differences along x, y and z, (…, 3), by code difference + `offset_origin`.

        They are 0 where no two cells have that difference.
        """
        steps = [np.arange(1 - n, n) for n in self.shape]
        codes = [axis * stride for axis, stride in zip(steps, self.strides, strict=True)]
        table = np.zeros((2 * self.num_codes - 1, 3), dtype=np.int64)
        table[_sums(codes) + self.offset_origin] = np.stack(np.meshgrid(*steps, indexing="ij"), -1)
        return table

    def offset_distances(self) -> Floats:
        """Euclidean distance in cells by code difference + `offset_origin`."""
        return self._by_offset(np.ones(3))

    def offset_distances_m(self, own_cell_m: float = 0.0) -> Floats:
        """Distance between centres of cells in m by code difference + `offset_origin`.

        Args:
            own_cell_m: what counts as the distance within one cell, and stands where no two
                cells have that difference.
        """
        table = self._by_offset(self._relative_edges) * min(self.edges_m)
        table[table == 0] = own_cell_m
        return table

    @cached_property
    def _relative_edges(self) -> Floats:
        return np.asarray(self.edges_m) / min(self.edges_m)

    def _by_offset(self, edges: Floats) -> Floats:
        """Lengths by code difference + `offset_origin`; 0 where no two cells have that one."""
        steps = [np.arange(1 - n, n) for n in self.shape]
        codes = [axis * stride for axis, stride in zip(steps, self.strides, strict=True)]
        squares = [(axis * edge) ** 2 for axis, edge in zip(steps, edges, strict=True)]
        table = np.zeros(2 * self.num_codes - 1)
        table[_sums(codes) + self.offset_origin] = np.sqrt(_sums(squares))
        return table


def _sums(axes: Sequence[npt.NDArray[Any]]) -> npt.NDArray[Any]:
    """The sum of one number of each of three axes, for all combinations."""
    x, y, z = np.ix_(*axes)
    return (x + y) + z
