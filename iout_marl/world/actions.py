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


class ActionCheck:
    """Takes the actions of a batch as the world takes them.

    The world itself does not look: an index out of its range would read the row of
    another node or cell.

    Args:
        num_envs, num_auvs: sizes of the batch.
        sizes: `World.action_sizes`.
    """

    def __init__(self, num_envs: int, num_auvs: int, sizes: Sequence[int]) -> None:
        self._sizes = tuple(sizes)
        self._shape = (num_envs, num_auvs, len(sizes))
        self._ends = np.broadcast_to(np.array(sizes, dtype=np.uint64), self._shape).copy()

    def __call__(self, action: Any) -> npt.NDArray[np.int64]:
        """The (envs, auvs, entries) integers.

        Raises:
            ValueError: the shape is another one, or an entry is not below its size.
        """
        values = integers(action)
        if values.shape != self._shape:
            raise ValueError(
                f"an action must have {len(self._sizes)} entries, below {self._sizes}: "
                f"expected an array of shape {self._shape}, not {values.shape}"
            )
        taken = values.astype(np.int64, copy=False)
        # Read without a sign, what is negative is beyond every size.
        inside = taken.view(np.uint64) < self._ends
        if not inside.all():
            worst = values[~inside.all(-1)][0]
            raise ValueError(
                f"action {worst.tolist()} lies outside MultiDiscrete({list(self._sizes)}): "
                "each entry counts from 0 and stays below its size"
            )
        return taken
