"""Actions from outside: checked before the world takes them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt


def integers(action: Any, what: str = "an action") -> npt.NDArray[Any]:
    """An action as an array of integers.

    Raises:
        ValueError: it is of something else, or ragged.
    """
    try:
        values = np.asarray(action)
    except ValueError:
        values = np.asarray(action, dtype=object)
    if values.dtype.kind not in "iu":
        raise ValueError(f"{what} must be integers, as many for every AUV, not {action!r}")
    return values


def checked_actions(
    action: Any, num_envs: int, num_auvs: int, sizes: Sequence[int]
) -> npt.NDArray[np.int64]:
    """The actions of a batch, as the world takes them.

    The world itself does not look: an index out of its range would read the row of
    another node or cell.

    Args:
        action: (envs, auvs, entries) integers.
        num_envs, num_auvs: sizes of the batch.
        sizes: `World.action_sizes`.

    Raises:
        ValueError: the shape is another one, or an entry is not below its size.
    """
    values = integers(action)
    shape = (num_envs, num_auvs, len(sizes))
    if values.shape != shape:
        raise ValueError(
            f"an action must have {len(sizes)} entries, below {tuple(sizes)}: "
            f"expected an array of shape {shape}, not {values.shape}"
        )
    outside = (values < 0) | (values >= sizes)
    if outside.any():
        worst = values[outside.any(-1)][0]
        raise ValueError(
            f"action {worst.tolist()} lies outside MultiDiscrete({list(sizes)}): "
            "each entry counts from 0 and stays below its size"
        )
    return values.astype(np.int64, copy=False)
