"""Arrays of any library: the one place that knows the Python array API standard.

Every function of the physics and of the world takes arrays of NumPy, torch or any
other library of the standard, or plain Python numbers, and answers in kind.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import array_api_compat
import numpy as np

#: An array of any library of the array API standard (NumPy, torch, …).
Array: TypeAlias = Any
#: An array, or a Python number that is read as a NumPy scalar.
ArrayLike: TypeAlias = Any


def as_arrays(*values: ArrayLike) -> tuple[Any, ...]:
    """The array namespace of `values`, then each of them as a floating array of it.

    Numbers and integer arrays take the floating type and the device of the first
    floating array beside them, float64 where there is none. Without any array the
    numbers become NumPy scalars; beside an array of any library a NumPy scalar counts
    as a number, so that what was computed from numbers alone goes with every library.
    """
    arrays = [v for v in values if array_api_compat.is_array_api_obj(v)]
    arrays = [v for v in arrays if not isinstance(v, np.generic)] or arrays
    if not arrays:
        return (np, *(np.float64(v) if np.ndim(v) == 0 else np.asarray(v, float) for v in values))
    xp = array_api_compat.array_namespace(*arrays)
    device = array_api_compat.device(arrays[0])
    dtype = next((a.dtype for a in arrays if xp.isdtype(a.dtype, "real floating")), xp.float64)
    return (xp, *(xp.asarray(v, dtype=dtype, device=device) for v in values))


def require(condition: Array, message: str) -> None:
    """Raise ValueError with `message` unless every element of `condition` is true."""
    if not bool(array_api_compat.array_namespace(condition).all(condition)):
        raise ValueError(message)


def lookup(xp: Any, table: Array, index: Array) -> Array:
    """Entries of a table, its axes laid end to end, at indices of any shape."""
    if xp is np:  # does just that by itself, which spares a single step a third of its time
        return table.take(index)
    return xp.reshape(xp.take(xp.reshape(table, (-1,)), xp.reshape(index, (-1,))), index.shape)
