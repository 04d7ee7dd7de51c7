"""The order of AUVs, which does not depend on their numbers."""

from typing import Any

from iout_marl.physics.arrays import Array, cast


def ranks(xp: Any, cell: Array, dtype: Any) -> Array:
    """How many AUVs come before each, (envs, auvs) floats, by their (envs, auvs) cells' codes.

    Of AUVs in one cell, which are where they are alike, those of lower number.
    """
    auvs = xp.arange(cell.shape[1], device=getattr(cell, "device", None))
    ahead, other = cell[:, None, :], cell[:, :, None]
    before = (ahead < other) | ((ahead == other) & (auvs[None, None, :] < auvs[None, :, None]))
    return cast(xp, xp.sum(before, axis=-1), dtype)
