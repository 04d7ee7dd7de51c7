"""Values between the points of a table."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from iout_marl.core.grid import Floats


def interpolated(axes: tuple[Floats, ...], table: Floats, points: tuple[Any, ...]) -> Floats:
    """A table at points, linearly along each axis; at and beyond its ends as at the ends.

    Args:
        axes: values along each axis of the table, the lowest first.
        table: an axis for each of them, and any behind those. What is not a number counts only
            where a point is nearer to it than a whole step.
        points: for each axis (points,) values.

    Returns:
        (points, …).
    """
    lower, shares = [], []
    for values, at in zip(axes, points, strict=True):
        place = np.clip(np.searchsorted(values, at, side="right") - 1, 0, max(len(values) - 2, 0))
        upper = np.minimum(place + 1, len(values) - 1)
        length = np.where(upper > place, values[upper] - values[place], 1.0)
        lower.append((place, upper))
        shares.append(np.clip((at - values[place]) / length, 0.0, 1.0))
    behind = table.shape[len(axes) :]
    result = np.zeros((len(points[0]), *behind))
    for corner in itertools.product((0, 1), repeat=len(axes)):
        weight = np.ones(len(result))
        for is_upper, share in zip(corner, shares, strict=True):
            weight = weight * (share if is_upper else 1 - share)
        places = tuple(both[is_upper] for both, is_upper in zip(lower, corner, strict=True))
        weight = weight.reshape(-1, *(1 for _ in behind))
        result += np.where(weight > 0, weight * table[places], 0.0)
    return result
