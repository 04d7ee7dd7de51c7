"""Where AUVs start that a scenario counts, but gives no cell."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def spread_starts(
    given: tuple[tuple[int, int, int], ...],
    count: int,
    grid: tuple[int, int, int],
    separation_cells: float,
) -> npt.NDArray[np.int64]:
    """Cells in which AUVs start, counted from 0, (auvs, 3): fewer where there is no more room.

    Those given come first; each further one is the cell whose distance from the nearest
    start before it is the largest, of equals the first in x, y and z.

    Args:
        given: cells of the first AUVs, counted from 1.
        count: number of AUVs.
        grid: cells of the grid along x, y and z.
        separation_cells: the distance that any two keep.
    """
    starts = [np.array(cell, dtype=np.int64) - 1 for cell in given[:count]]
    if len(starts) < count:
        cells = np.stack(np.unravel_index(np.arange(np.prod(grid)), grid), axis=-1)
        squared = np.min([((cells - start) ** 2).sum(-1) for start in starts], axis=0)
        while len(starts) < count and squared.max() >= max(separation_cells**2, 1):
            starts.append(cells[int(squared.argmax())])
            squared = np.minimum(squared, ((cells - starts[-1]) ** 2).sum(-1))
    return np.array(starts)
