"""Arrays of any library: the one place that knows the Python array API standard.

Every function of the physics and of the world takes arrays of NumPy, torch or any
other library of the standard, or plain Python numbers, and answers in kind.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import array_api_compat
import numpy as np

#: An array of any library of the array API standard (NumPy, torch, …).
Array: TypeAlias = Any
#: An array, or a Python number that is read as a NumPy scalar.
ArrayLike: TypeAlias = Any

#: What NumPy alone is needed for.
_OF_NUMPY = (np.ndarray, np.generic, int, float)


def namespace(*arrays: Array) -> Any:
    """The array namespace of arrays: NumPy itself, whose wrapper takes long to be imported."""
    if all(isinstance(array, (np.ndarray, np.generic)) for array in arrays):
        return np
    return array_api_compat.array_namespace(*arrays)


def as_arrays(*values: ArrayLike) -> tuple[Any, ...]:
    """The array namespace of `values`, then each of them as a floating array of it.

    Numbers and integer arrays take the floating type and the device of the first
    floating array beside them, float64 where there is none. Without any array the
    numbers become NumPy scalars; beside an array of any library a NumPy scalar counts
    as a number, so that what was computed from numbers alone goes with every library.
    """
    # Most are of NumPy: whose each of them is need not be asked one by one.
    of_numpy = all(isinstance(v, _OF_NUMPY) for v in values)
    if of_numpy:
        arrays = [v for v in values if isinstance(v, (np.ndarray, np.generic))]
    else:
        arrays = [v for v in values if array_api_compat.is_array_api_obj(v)]
    arrays = [v for v in arrays if not isinstance(v, np.generic)] or arrays
    if not arrays:
        return (np, *(np.float64(v) if np.ndim(v) == 0 else np.asarray(v, float) for v in values))
    if of_numpy:
        dtype = next((a.dtype for a in arrays if a.dtype.kind == "f"), np.float64)
        return (np, *(np.asarray(v, dtype) for v in values))
    xp = namespace(*arrays)
    device = array_api_compat.device(arrays[0])
    dtype = next((a.dtype for a in arrays if xp.isdtype(a.dtype, "real floating")), xp.float64)
    on_numpy = isinstance(arrays[0], np.ndarray)

    def as_array(value: ArrayLike) -> Array:
        if on_numpy:
            return xp.asarray(value, dtype=dtype, device=device)
        if isinstance(value, int | float | np.generic):
            # Made where it is needed: an accelerator would stop for a number brought to it.
            return xp.full((), float(value), dtype=dtype, device=device)
        if not array_api_compat.is_array_api_obj(value) or array_api_compat.device(value) != device:
            return xp.asarray(value, dtype=dtype, device=device)
        # torch's `asarray` would make another one, without its gradient.
        return value if value.dtype == dtype else xp.astype(value, dtype)

    return (xp, *map(as_array, values))


def adds_at_indices(xp: Any) -> bool:
    """Whether `add_at` works: the standard itself has nothing of the kind."""
    return xp is np or hasattr(xp, "index_add")


def takes_rows(xp: Any) -> bool:
    """Whether there is `index_select`, torch's `take` along an axis, of no negative indices."""
    return hasattr(xp, "index_select")


def add_at(xp: Any, values: Array, index: Array, amount: Array) -> Array:
    """The values with amounts added to entries, their axes laid end to end, at indices.

    Both are of any shape. Where an index comes twice, both amounts are added, in any order
    but on NumPy.
    """
    if xp is np:
        sums = values.copy()
        np.add.at(sums.ravel(), index.ravel(), amount.ravel())
        return sums
    flat, index, amount = (xp.reshape(array, (-1,)) for array in (values, index, amount))
    return xp.reshape(xp.index_add(flat, 0, index, amount), values.shape)


def cast(xp: Any, array: Array, dtype: Any) -> Array:
    """The array in another type."""
    return array.astype(dtype) if xp is np else xp.astype(array, dtype)


def pick(xp: Any, pair: Array, flags: Array) -> Array:
    """The second of a pair of values where flags are set, elsewhere the first."""
    # A table of two does not depend on how well a processor guesses the flags.
    return pair.take(flags) if xp is np else xp.where(flags, pair[1], pair[0])


def is_known_equal(xp: Any, one: Array, other: Array) -> bool:
    """Whether two arrays are equal, as far as that may be asked: never but on NumPy.

    An answer would stop an accelerator, and end a graph that is recorded or compiled.
    """
    return xp is np and bool((one == other).all())


def reverse_axes(xp: Any, array: Array) -> Array:
    """The array with its axes in reverse order, as a view."""
    if xp is np:
        return array.T
    return xp.permute_dims(array, tuple(reversed(range(array.ndim))))


def joined(xp: Any, arrays: Sequence[Array]) -> Array:
    """Arrays side by side along their last axis, laid out as `Backend.with_envs_inside` does."""
    return reverse_axes(xp, xp.concat([reverse_axes(xp, array) for array in arrays], axis=0))


# Where NumPy has a method of its own, that spares a single environment, whose arrays are
# tiny, much of the time of its steps.


def lookup(xp: Any, table: Array, index: Array) -> Array:
    """Entries of a table, its axes laid end to end, at indices of any shape, none negative."""
    if xp is np:
        return table.take(index)
    table, places = xp.reshape(table, (-1,)), xp.reshape(index, (-1,))
    # The standard's function would first look for negative indices: three operations more on torch.
    found = xp.index_select(table, 0, places) if takes_rows(xp) else xp.take(table, places)
    return xp.reshape(found, index.shape)


def lookup_inside(xp: Any, table: Array, index: Array) -> Array:
    """`lookup`, laid out in memory as the indices are where their first axis is the inner one.

    NumPy would lay out entries by the last axis: whatever comes after them would cost more.
    """
    return reverse_axes(xp, lookup(xp, table, reverse_axes(xp, index)))


def add_up(xp: Any, values: Array, axis: int) -> Array:
    """Sums along an axis."""
    return np.add.reduce(values, axis=axis) if xp is np else xp.sum(values, axis=axis)


def highest(xp: Any, values: Array, axis: int) -> Array:
    """The highest numbers along an axis."""
    # What `np.max` comes down to, in less than half its time for a single environment.
    return np.maximum.reduce(values, axis=axis) if xp is np else xp.max(values, axis=axis)


def rounds_otherwise(xp: Any) -> None:
    """Say that NumPy does in another order what is done here, and its last digit may be another.

    It matters to a library that writes down what is done in place of NumPy, if it asks for it.
    """
    if note := getattr(xp, "rounds_otherwise", None):
        note()
