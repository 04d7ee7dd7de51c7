"""Where AUVs start that a scenario does not place itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt


def spread_starts(
    given: Sequence[Sequence[int]],
    num_auvs: int,
    grid_cells: tuple[int, int, int],
    separation_cells: float,
    axes_moved: Sequence[bool] = (True, True, True),
) -> npt.NDArray[np.int64]:
    """Coordinates from 0 of the cells in which the AUVs start.

    Those given come first; each further one is the cell whose distance from the nearest start
    before it is the largest, of equals the first in x, y and z. Along axes that no AUV
    moves along it has the coordinate of a given one.

    Args:
        given: cells counted from 1, as many as there are AUVs or fewer, at least one.
        num_auvs: M.
        grid_cells: cells along x, y and z.
        separation_cells: distance that starts must keep.
        axes_moved: whether AUVs move along x, y and z.

    Returns:
        (auvs, 3); fewer where no further AUV finds room at that separation.
    """
    starts = [np.array(cell, dtype=np.int64) - 1 for cell in given[:num_auvs]]
    if len(starts) == num_auvs:
        return np.array(starts)
    axes = np.ogrid[tuple(slice(n) for n in grid_cells)]

    def squared_from(start: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        x, y, z = ((axis - at) ** 2 for axis, at in zip(axes, start, strict=True))
        squared: npt.NDArray[np.int64] = x + y + z
        return squared

    nearest = squared_from(starts[0])
    for start in starts[1:]:
        np.minimum(nearest, squared_from(start), out=nearest)
    for axis in np.flatnonzero(~np.array(axes_moved)):
        is_given = np.isin(axes[axis], [start[axis] for start in starts])
        nearest = np.where(is_given, nearest, -1)
    while len(starts) < num_auvs:
        farthest = int(nearest.argmax())
        # No two in one cell, even where nothing else keeps them apart.
        if nearest.flat[farthest] < max(separation_cells**2, 1):
            break
        starts.append(np.array(np.unravel_index(farthest, grid_cells), dtype=np.int64))
        np.minimum(nearest, squared_from(starts[-1]), out=nearest)
    return np.array(starts)
