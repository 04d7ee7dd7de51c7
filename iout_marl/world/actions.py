"""Actions and layouts from outside: checked before the world takes them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import array_api_compat
import numpy as np
import numpy.typing as npt

from iout_marl.core.grid import Grid
from iout_marl.errors import InputError
from iout_marl.whole import short


def integers(action: Any, what: str = "an action") -> npt.NDArray[Any]:
    """An action as an array of integers.

    Raises:
        InputError: it is of something else, or ragged.
    """
    try:
        values = action if isinstance(action, np.ndarray) else np.asarray(_on_host(action))
    # Of what is ragged, and of lists of arrays of other libraries, NumPy makes nothing.
    except (ValueError, TypeError, RuntimeError):
        values = np.empty(0, dtype=object)
    if values.dtype.kind not in "iu":
        raise InputError(f"{what} must be integers, as many for every AUV, not {short(action)}")
    return values


def entries_of(action: Any, count: int, what: str = "an action") -> npt.NDArray[Any]:
    """The action of one AUV as an array of `count` integers.

    Raises:
        InputError: it is something else.
    """
    values = integers(action, what)
    if values.shape != (count,):
        raise InputError(f"{what} must have shape {(count,)}, not {values.shape}")
    return values


def _on_host(values: Any) -> Any:
    """A tensor where NumPy can read it; anything else as it is."""
    return values.detach().cpu() if array_api_compat.is_torch_array(values) else values


def is_on_accelerator(values: Any) -> bool:
    """Whether an accelerator would have to stop for one to look at them."""
    return array_api_compat.is_torch_array(values) and values.device.type != "cpu"


class LayoutCheck:
    """Takes the layouts of a batch as the world takes them: codes of cells of the grid.

    Args:
        shape: (envs, nodes).
        grid: the grid.
    """

    def __init__(self, shape: tuple[int, int], grid: Grid) -> None:
        self._shape = shape
        self._is_cell = np.zeros(grid.num_codes, dtype=np.bool_)
        self._is_cell[grid.encode(grid.all_coordinates())] = True

    def __call__(self, node_cell: Any) -> None:
        """Look at a layout.

        Raises:
            InputError: it is not (envs, nodes) codes of cells.
        """
        codes = integers(node_cell, "node_cell")
        if codes.shape != self._shape:
            raise InputError(
                f"node_cell must be the codes of the nodes' cells, (envs, nodes): "
                f"of shape {self._shape}, not {codes.shape}"
            )
        inside = (codes >= 0) & (codes < len(self._is_cell))
        inside &= self._is_cell[np.where(inside, codes, 0)]
        if not inside.all():
            raise InputError(
                f"node_cell: {codes[~inside][0]} is the code of no cell of the grid; "
                "`Grid.encode` gives codes, `node_codes` those of a scenario's nodes"
            )


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
            InputError: the shape is another one, or an entry is not below its size.
        """
        values = integers(action)
        if values.shape != self._shape:
            raise InputError(
                f"an action must have {len(self._sizes)} entries, below {self._sizes}: "
                f"expected an array of shape {self._shape}, not {values.shape}"
            )
        taken = values.astype(np.int64, copy=False)
        # Read without a sign, what is negative is beyond every size.
        inside = taken.view(np.uint64) < self._ends
        # Of a few numbers in a third of the time that `all` takes.
        if np.count_nonzero(inside) < inside.size:
            env, auv = np.argwhere(~inside.all(-1))[0]
            whose = "" if self._shape[:2] == (1, 1) else f"environment {env}, auv_{auv}: "
            raise InputError(
                f"{whose}action {values[env, auv].tolist()} lies outside "
                f"MultiDiscrete({list(self._sizes)}): "
                "each entry counts from 0 and stays below its size"
            )
        return taken
