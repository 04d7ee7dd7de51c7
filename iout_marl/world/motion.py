"""Motion: where a direction takes an AUV."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from iout_marl.arrays.backend import Backend
from iout_marl.core.grid import Grid
from iout_marl.physics.arrays import Array, lookup


class Mover:
    """Moves AUVs from cell to cell.

    In a grid of one cell there is nowhere to go: every direction stays, and none leaves the grid.

    Args:
        grid: the grid.
        steps: of each direction, the cells that it leads along x, y and z.
        separation_cells: distance that any two AUVs keep; 0 for no rule.
        backend: arrays to work with.
    """

    def __init__(
        self, grid: Grid, steps: Sequence[Sequence[int]], separation_cells: float, backend: Backend
    ) -> None:
        self.steps = np.array(steps)
        self.num_directions = len(self.steps)
        self._backend = backend
        self._xp = backend.xp
        neighbours, inside = _neighbour_tables(grid, self.steps)
        self.neighbour = backend.integers(neighbours.reshape(-1))
        self._leads_outside = backend.xp.asarray(~inside.reshape(-1), device=backend.device)
        self._per_cell = backend.integers(self.num_directions)
        self._never = backend.xp.asarray(False, device=backend.device)  # noqa: FBT003
        self._keeps_apart = separation_cells > 0
        too_near = grid.offset_distances() < separation_cells * (1 - 1e-12)
        self._too_near = backend.xp.asarray(too_near, device=backend.device)
        self._origin = grid.offset_origin

    def move(self, cell: Array, direction: Array) -> tuple[Array, Array, Array]:
        """One slot's moves (eq. `direction`), all at once; who would leave the grid stays.

        Of AUVs whose moves would end too near one another, or swap their cells, all that
        move stay; so do those whose moves would then end too near one that stays. The
        order of the AUVs does not matter, and AUVs that were apart stay apart.

        Args:
            cell: (envs, auvs) codes.
            direction: (envs, auvs) indices of directions.

        Returns:
            the new cells, who would have left the grid, and who was kept from moving by
            another AUV, (envs, auvs) each.
        """
        index = cell * self._per_cell + direction
        left_grid = lookup(self._xp, self._leads_outside, index)
        target = lookup(self._xp, self.neighbour, index)
        if cell.shape[1] == 1 or not self._keeps_apart:
            return target, left_grid, left_grid & self._never
        new_cell = self._apart(cell, target)
        return new_cell, left_grid, new_cell != target

    def _apart(self, cell: Array, target: Array) -> Array:
        """The targets of all that can move, the old cells of the others."""
        xp = self._xp
        auvs = xp.arange(cell.shape[1], device=cell.device)
        another = auvs[:, None] != auvs[None, :]
        new_cell = target
        # Whoever stops may stop another: a chain of all AUVs takes as many rounds.
        for _ in range(cell.shape[1]):
            near = lookup(xp, self._too_near, self._between(new_cell, new_cell))
            swaps = self._between(new_cell, cell) == self._origin
            swaps = swaps & xp.matrix_transpose(swaps)
            moves = new_cell != cell
            stops = moves & xp.any((near | (swaps & moves[:, None, :])) & another, axis=2)
            if self._backend.surely_none(stops):
                break
            new_cell = xp.where(stops, cell, new_cell)
        return new_cell

    def _between(self, first: Array, second: Array) -> Array:
        """Code differences + origin of every pair: (envs, auvs, auvs)."""
        return first[:, :, None] - second[:, None, :] + self._origin

    def stays_inside(self, cell: Array) -> Array:
        """Which directions keep an AUV in the grid: (envs, auvs, directions) bool."""
        return ~lookup(self._xp, self._leads_outside, self._every_direction(cell))

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
    is_inside[here] = inside | (grid.num_cells == 1)
    return code, is_inside
