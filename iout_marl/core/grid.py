"""The grid of cells, and the codes by which the world names them.

A cell has one integer code, laid out so that the difference of two codes tells how far
apart the cells are in each direction. A table over code differences thus holds whatever
depends on where two cells lie to one another (distance, attenuation, …).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from iout_marl.scenario import Scenario


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

    @property
    def strides(self) -> npt.NDArray[np.int64]:
        """Step of the code for one cell along x, y and z.

        An axis of n cells takes 2n − 1 values, for the differences −(n−1) … n−1: so no
        two different offsets have the same difference of codes.
        """
        _, y, z = self.shape
        return np.array([(2 * y - 1) * (2 * z - 1), 2 * z - 1, 1])

    @property
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

    def lengths(self, steps: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Lengths of (…, 3) differences in cells, as multiples of the shortest edge: (…).

        In cubic cells they are those in cells, whatever the edge, to the last bit.
        """
        relative = np.asarray(self.edges_m) / min(self.edges_m)
        lengths: npt.NDArray[np.float64] = np.linalg.norm(np.asarray(steps) * relative, axis=-1)
        return lengths

    def metres(self, steps: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Lengths of (…, 3) differences in cells, in m: (…)."""
        return self.lengths(steps) * min(self.edges_m)

    def offset_distances(self) -> npt.NDArray[np.float64]:
        """Euclidean distance in cells by code difference + `offset_origin`."""
        places, steps = self._offsets()
        table = np.zeros(2 * self.num_codes - 1)
        table[places] = np.sqrt((steps**2).sum(-1))
        return table

    def offset_distances_m(self, own_cell_m: float = 0.0) -> npt.NDArray[np.float64]:
        """Distance between centres of cells in m by code difference + `offset_origin`.

        Args:
            own_cell_m: what counts as the distance within one cell, and stands where no two
                cells have that difference.
        """
        places, steps = self._offsets()
        table = np.full(2 * self.num_codes - 1, own_cell_m)
        table[places] = np.where(steps.any(-1), self.metres(steps), own_cell_m)
        return table

    def _offsets(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Of all differences between cells: indices into such a table, and (…, 3) steps."""
        axes = [np.arange(1 - n, n) for n in self.shape]
        steps = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        return self.encode(steps) + self.offset_origin, steps
