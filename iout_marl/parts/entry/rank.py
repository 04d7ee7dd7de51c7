"""The order of AUVs and of nodes, which does not depend on their numbers."""

from typing import Any

from iout_marl.physics.arrays import Array, cast

#: Up to how many numbers each is compared with each other; more are sorted.
_FEW = 64


def count_greater(xp: Any, values: Array) -> Array:
    """How many of the numbers along the last axis are greater than each, as integers."""
    size = values.shape[-1]
    if size <= _FEW:
        return xp.sum(values[..., None, :] > values[..., :, None], axis=-1)
    order = xp.argsort(values, axis=-1)
    ordered = xp.take_along_axis(values, order, axis=-1)
    place = xp.arange(size, device=getattr(values, "device", None))
    # Equal numbers lie side by side: no more are greater than the last of them has behind it.
    is_last = xp.concat(
        [ordered[..., 1:] > ordered[..., :-1], ordered[..., :1] == ordered[..., :1]], axis=-1
    )
    last = xp.sort(xp.where(is_last, place, size), axis=-1)
    is_last = cast(xp, is_last, place.dtype)
    kind = xp.cumulative_sum(is_last, axis=-1) - is_last
    behind = size - 1 - xp.take_along_axis(last, kind, axis=-1)
    return xp.take_along_axis(behind, xp.argsort(order, axis=-1), axis=-1)


def ranks(xp: Any, cell: Array, dtype: Any) -> Array:
    """How many AUVs come before each, (envs, auvs) floats, by their (envs, auvs) cells' codes.

    Of AUVs in one cell, which are where they are alike, those of lower number.
    """
    auvs = xp.arange(cell.shape[1], device=getattr(cell, "device", None))
    ahead, other = cell[:, None, :], cell[:, :, None]
    before = (ahead < other) | ((ahead == other) & (auvs[None, None, :] < auvs[None, :, None]))
    return cast(xp, xp.sum(before, axis=-1), dtype)
