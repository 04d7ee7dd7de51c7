"""The grid of cells, and the codes by which the world names them.

A cell has one integer code, laid out so that the difference of two codes tells how far
apart the cells are in each direction. A table over code differences thus holds whatever
depends on where two cells lie to one another (distance, attenuation, …).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class Grid:
    """A grid of `shape` cells along x, y and z, counted from 0 here."""

    shape: tuple[int, int, int]

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

    def offset_distances(self) -> npt.NDArray[np.float64]:
        """Euclidean distance in cells by code difference + `offset_origin`."""
        x, y, z = self.shape
        axes = [np.arange(1 - n, n) for n in (x, y, z)]
        offsets = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        table = np.zeros(2 * self.num_codes - 1)
        table[self.encode(offsets) + self.offset_origin] = np.sqrt((offsets**2).sum(-1))
        return table
