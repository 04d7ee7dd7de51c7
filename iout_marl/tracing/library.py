"""What array libraries have in common that write down what is done to their arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

#: Types of numbers, the widest last.
_KINDS = (bool, int, float)
KIND_OF: dict[str, type] = {"b": bool, "i": int, "u": int, "f": float}
#: NumPy's functions that only move numbers.
_MOVING = ("reshape", "permute_dims", "matrix_transpose", "broadcast_to")


class UnknownOperationError(Exception):
    """An operation that cannot be written down."""


class TracedArray:
    """An array of numbers of which some are not known yet, of one kind: bool, int or float."""

    #: NumPy arrays leave operations with it to it.
    __array_ufunc__ = None
    device = None
    kind: type

    def viewed(self, view: Callable[[Any], Any]) -> Any:
        """The array with its numbers moved."""
        raise NotImplementedError

    def __array__(self, *_: Any, **__: Any) -> Any:
        raise UnknownOperationError("NumPy needs to know the numbers")

    def __bool__(self) -> bool:
        raise UnknownOperationError("a branch needs to know the number")

    __float__ = __int__ = __index__ = __bool__


def kind_of(array: Any) -> type:
    """The kind of an array's numbers, known or not."""
    if isinstance(array, TracedArray):
        return array.kind
    return KIND_OF[np.asarray(array).dtype.kind]


def widest(*arrays: Any) -> type:
    """The kind that has room for the numbers of all."""
    return max((kind_of(array) for array in arrays), key=_KINDS.index)


class TracingLibrary:
    """Functions for traced arrays; NumPy's where every number is known.

    Args:
        functions: what the library has, by name, beside what only moves numbers.
    """

    def __init__(self, functions: Mapping[str, Callable[..., Any]]) -> None:
        own = {**functions, **{name: _moved(getattr(np, name)) for name in _MOVING}}
        vars(self).update({name: _either(function, name) for name, function in own.items()})

    def __getattr__(self, name: str) -> Any:
        found = getattr(np, name)
        return _of_known(found, name) if callable(found) and not isinstance(found, type) else found


def _moved(move: Callable[..., Any]) -> Callable[..., Any]:
    return lambda a, *args, **kwargs: a.viewed(lambda values: move(values, *args, **kwargs))


def _of_known(function: Callable[..., Any], name: str) -> Callable[..., Any]:
    """NumPy's function, of numbers that are known alone."""

    def of_known(*args: Any, **kwargs: Any) -> Any:
        if any(isinstance(each, TracedArray) for each in (*args, *kwargs.values())):
            raise UnknownOperationError(f"`{name}`")
        return function(*args, **kwargs)

    return of_known


def _either(for_traced: Callable[..., Any], name: str) -> Callable[..., Any]:
    def function(*args: Any, **kwargs: Any) -> Any:
        given = [*args, *args[0]] if isinstance(args[0], list | tuple) else args
        if any(isinstance(each, TracedArray) for each in given):
            return for_traced(*args, **kwargs)
        return getattr(np, name)(*args, **kwargs)

    return function
