"""Motion: where a direction takes an AUV."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from iout_marl.physics.arrays import Array, lookup
from iout_marl.world.backend import Backend
from iout_marl.world.grid import Grid

#: The directions of each motion part, as steps in cells. `six` is the paper's eq.
#: `direction`: right, left, up, down, forward, backward; there is no way to stay.
DIRECTIONS: dict[str, tuple[tuple[int, int, int], ...]] = {
    "six": ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)),
}


class Motion:
    """Moves AUVs from cell to cell.

    Args:
        grid: the grid.
        kind: name of a motion part, a key of `DIRECTIONS`.
        backend: arrays to work with.
    """

    def __init__(self, grid: Grid, kind: str, backend: Backend) -> None:
        self.steps = np.array(DIRECTIONS[kind])
        self.num_directions = len(self.steps)
        self._xp = backend.xp
        neighbours = _neighbour_table(grid, self.steps)
        self.neighbour = backend.integers(neighbours.reshape(-1))
        own_code = np.arange(grid.num_codes)[:, None]
        self._leads_inside = backend.xp.reshape(
            backend.xp.asarray(neighbours != own_code, device=backend.device), (-1,)
        )

    def move(self, cell: Array, direction: Array) -> tuple[Array, Array]:
        """One slot's move (eq. `direction`); who would leave the grid stays.

        Args:
            cell: (envs, auvs) codes.
            direction: (envs, auvs) indices of directions.

        Returns:
            the new cells, (envs, auvs), and who would have left the grid, (envs, auvs) bool.
        """
        new_cell = lookup(self._xp, self.neighbour, cell * self.num_directions + direction)
        return new_cell, new_cell == cell

    def stays_inside(self, cell: Array) -> Array:
        """Which directions keep an AUV in the grid: (envs, auvs, directions) bool."""
        return lookup(self._xp, self._leads_inside, self._every_direction(cell))

    def neighbours(self, cell: Array) -> Array:
        """The cell that each direction leads to: (envs, auvs, directions) codes."""
        return lookup(self._xp, self.neighbour, self._every_direction(cell))

    def _every_direction(self, cell: Array) -> Array:
        """Index into the tables of each direction from each cell."""
        directions = self._xp.arange(self.num_directions, device=cell.device)
        return cell[..., None] * self.num_directions + directions


def _neighbour_table(grid: Grid, steps: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """(codes, directions): the code that each direction leads to, the own one at the edge."""
    cells = grid.all_coordinates()
    targets = cells[:, None, :] + steps
    inside = ((targets >= 0) & (targets < np.array(grid.shape))).all(-1)
    here = grid.encode(cells)
    table = np.zeros((grid.num_codes, len(steps)), dtype=np.int64)
    table[here] = np.where(inside, grid.encode(targets), here[:, None])
    return table
