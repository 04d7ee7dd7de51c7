"""Motion: where a direction takes an AUV."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from iout_marl.physics.arrays import Array, lookup
from iout_marl.world.backend import Backend
from iout_marl.world.grid import Grid

#: The directions of each motion part, as steps in cells. `six` is the paper's eq.
#: `direction`: right, left, up, down, forward, backward; there is no way to stay.
_SIX = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
DIRECTIONS: dict[str, tuple[tuple[int, int, int], ...]] = {
    "six": _SIX,
    "hover": (*_SIX, (0, 0, 0)),
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
        neighbours, inside = _neighbour_tables(grid, self.steps)
        self.neighbour = backend.integers(neighbours.reshape(-1))
        self._leads_inside = backend.xp.asarray(inside.reshape(-1), device=backend.device)

    def move(self, cell: Array, direction: Array) -> tuple[Array, Array]:
        """One slot's move (eq. `direction`); who would leave the grid stays.

        Args:
            cell: (envs, auvs) codes.
            direction: (envs, auvs) indices of directions.

        Returns:
            the new cells, (envs, auvs), and who would have left the grid, (envs, auvs) bool.
        """
        index = cell * self.num_directions + direction
        inside = lookup(self._xp, self._leads_inside, index)
        return lookup(self._xp, self.neighbour, index), ~inside

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


def _neighbour_tables(
    grid: Grid, steps: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
    """Where each direction leads, the own cell at the edge, and whether it stays in the grid.

    Both are (codes, directions).
    """
    cells = grid.all_coordinates()
    targets = cells[:, None, :] + steps
    inside = ((targets >= 0) & (targets < np.array(grid.shape))).all(-1)
    here = grid.encode(cells)
    code = np.zeros((grid.num_codes, len(steps)), dtype=np.int64)
    code[here] = np.where(inside, grid.encode(targets), here[:, None])
    is_inside = np.zeros(code.shape, dtype=np.bool_)
    is_inside[here] = inside
    return code, is_inside
