"""Numbers that are not known yet, in arrays: an array library that writes down what it does.

What the world does to arrays of `SymbolArray` becomes the lines of a Python function, one for
each operation on each number. Of the array API standard there is what the world asks for; what
only builds tables of known numbers is left to NumPy.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from iout_marl.tracing.library import (
    KIND_OF,
    TracedArray,
    TracingLibrary,
    UnknownOperationError,
    kind_of,
    widest,
)
from iout_marl.tracing.program import Program, Symbol, divide, expm1, sqrt


def _program_of(*operands: Any) -> Program | None:
    return next((o.program for o in operands if isinstance(o, Symbol)), None)


def _elementwise(
    form: str, known: Callable[..., Any], neutral: Any = None
) -> Callable[..., npt.NDArray[Any]]:
    """A function of arrays of objects: a line for symbols, a result where all is known.

    Args:
        form: the line.
        known: what it says, as a function.
        neutral: a second (or first) operand that changes nothing.
    """

    def each(*operands: Any) -> Any:
        program = _program_of(*operands)
        if program is None:
            return known(*operands)
        if neutral is not None:
            changing = [o for o in operands if isinstance(o, Symbol) or o != neutral]
            if len(changing) == 1:
                return changing[0]
        return program.line(form, *operands)

    def over_arrays(*arrays: Any) -> npt.NDArray[Any]:
        ufunc = np.frompyfunc(each, len(arrays), 1)
        return np.asarray(ufunc(*(np.asarray(a, dtype=object) for a in arrays)), dtype=object)

    return over_arrays


_add = _elementwise("{} + {}", operator.add)
_add_integers = _elementwise("{} + {}", operator.add, neutral=0)
_subtract = _elementwise("{} - {}", operator.sub)
_multiply = _elementwise("{} * {}", operator.mul)
_multiply_alike = _elementwise("{} * {}", operator.mul, neutral=1)
_divided = _elementwise("{0} / {1} if {1} else divide({0}, {1})", divide)
_negated = _elementwise("-{}", operator.neg)
_squared = _elementwise("{0} * {0}", lambda value: value * value)
_and = _elementwise("{} and {}", lambda a, b: a and b, neutral=True)
_or = _elementwise("{} or {}", lambda a, b: a or b, neutral=False)
_not = _elementwise("not {}", operator.not_)
_compared = {
    sign: _elementwise(f"{{}} {sign} {{}}", function)
    for sign, function in {
        "<": operator.lt,
        "<=": operator.le,
        ">": operator.gt,
        ">=": operator.ge,
        "==": operator.eq,
        "!=": operator.ne,
    }.items()
}
_chosen = _elementwise("{1} if {0} else {2}", lambda flag, a, b: a if flag else b)
# Of numbers that compare: not what NumPy does where one is NaN.
_larger = _elementwise("{0} if {0} > {1} else {1}", max)
_smaller = _elementwise("{0} if {0} < {1} else {1}", min)
_to_float = {
    bool: _elementwise("1.0 if {} else 0.0", float),
    int: _elementwise("float({})", float),
}
_to_integer = _elementwise("int({})", int)
_root = _elementwise("sqrt({})", sqrt)
_exponential_less_one = _elementwise("expm1({})", expm1)


def objects(operand: Any) -> Any:
    """The symbols and numbers of an array; any other operand as it is."""
    return operand.values if isinstance(operand, SymbolArray) else operand


class SymbolArray(TracedArray):
    """An array of symbols and of known numbers, of one kind: bool, int or float."""

    def __init__(self, values: Any, kind: type) -> None:
        self.values: npt.NDArray[Any] = np.asarray(values, dtype=object)
        self.kind = kind

    @classmethod
    def unknown(cls, program: Program, name: str, like: npt.NDArray[Any]) -> SymbolArray:
        """Parameters of a program, in the shape and of the kind of an array."""
        return cls(program.parameters(name, like.shape), KIND_OF[like.dtype.kind])

    def __array_namespace__(self, api_version: str | None = None) -> Any:
        return LIBRARY

    @property
    def shape(self) -> tuple[int, ...]:
        return self.values.shape

    @property
    def ndim(self) -> int:
        return self.values.ndim

    @property
    def dtype(self) -> np.dtype[Any]:
        return np.dtype(self.kind)

    def viewed(self, view: Callable[[Any], Any]) -> SymbolArray:
        return SymbolArray(view(self.values), self.kind)

    def __getitem__(self, key: Any) -> SymbolArray:
        return SymbolArray(self.values[key], self.kind)

    def __add__(self, other: Any) -> SymbolArray:
        kind = widest(self, other)
        return _of(_add_integers if kind is int else _add, kind, self, other)

    def __sub__(self, other: Any) -> SymbolArray:
        return _of(_subtract, widest(self, other), self, other)

    def __rsub__(self, other: Any) -> SymbolArray:
        return _of(_subtract, widest(self, other), other, self)

    def __mul__(self, other: Any) -> SymbolArray:
        product = _multiply_alike if self.kind is kind_of(other) else _multiply
        return _of(product, widest(self, other), self, other)

    def __truediv__(self, other: Any) -> SymbolArray:
        return _of(_divided, float, self, other)

    def __rtruediv__(self, other: Any) -> SymbolArray:
        return _of(_divided, float, other, self)

    def __matmul__(self, other: Any) -> SymbolArray:
        """With a vector."""
        if np.ndim(objects(other)) != 1:
            raise UnknownOperationError("a product with a matrix on the right")
        return _sum(self * other, -1)

    def __rmatmul__(self, other: Any) -> SymbolArray:
        """The product of a matrix with this one, or with each of several."""
        return _sum(self[..., None, :, :] * other[..., None], -2)

    def __pow__(self, power: int) -> SymbolArray:
        if power != 2:
            raise UnknownOperationError(f"power {power}")
        return _of(_squared, self.kind, self)

    def __neg__(self) -> SymbolArray:
        return _of(_negated, self.kind, self)

    def __invert__(self) -> SymbolArray:
        return _of_flags(_not, self)

    def __and__(self, other: Any) -> SymbolArray:
        return _of_flags(_and, self, other)

    def __or__(self, other: Any) -> SymbolArray:
        return _of_flags(_or, self, other)

    def __lt__(self, other: Any) -> SymbolArray:
        return _of(_compared["<"], bool, self, other)

    def __le__(self, other: Any) -> SymbolArray:
        return _of(_compared["<="], bool, self, other)

    def __gt__(self, other: Any) -> SymbolArray:
        return _of(_compared[">"], bool, self, other)

    def __ge__(self, other: Any) -> SymbolArray:
        return _of(_compared[">="], bool, self, other)

    def __eq__(self, other: object) -> SymbolArray:  # type: ignore[override]
        return _of(_compared["=="], bool, self, other)

    def __ne__(self, other: object) -> SymbolArray:  # type: ignore[override]
        return _of(_compared["!="], bool, self, other)

    __hash__ = None  # type: ignore[assignment]
    __radd__, __rmul__, __rand__, __ror__ = __add__, __mul__, __and__, __or__


def _of(function: Callable[..., npt.NDArray[Any]], kind: type, *operands: Any) -> SymbolArray:
    return SymbolArray(function(*(objects(operand) for operand in operands)), kind)


def _of_flags(function: Callable[..., npt.NDArray[Any]], *operands: Any) -> SymbolArray:
    if widest(*operands) is not bool:
        raise UnknownOperationError("an operation on the bits of numbers")
    return _of(function, bool, *operands)


def _reduced(
    function: Callable[..., npt.NDArray[Any]], values: SymbolArray, axis: int, *, keepdims: bool
) -> SymbolArray:
    parts = np.moveaxis(values.values, axis, 0)
    result = functools.reduce(function, parts)
    return SymbolArray(np.expand_dims(result, axis) if keepdims else result, values.kind)


def _concat(arrays: Sequence[Any], axis: int = 0) -> SymbolArray:
    parts = [np.asarray(objects(a), dtype=object) for a in arrays]
    return SymbolArray(np.concatenate(parts, axis=axis), widest(*arrays))


def _sum(values: SymbolArray, axis: int, *, keepdims: bool = False) -> SymbolArray:
    if values.kind is bool:
        values = SymbolArray(values.values, int)
    if values.shape[axis] == 0:
        return SymbolArray(np.sum(values.values, axis=axis, keepdims=keepdims), values.kind)
    return _reduced(_add, values, axis, keepdims=keepdims)


def _take(table: Any, index: Any) -> SymbolArray:
    """Entries of a table, of which entries or indices, or both, are symbols."""

    def each(i: Any) -> Any:
        if not isinstance(i, Symbol):
            return table[i]
        if isinstance(table, SymbolArray):
            form = "(" + "{}, " * len(table.values) + ")[{}]"
            return i.program.line(form, *table.values, i)
        return i.program.line("{}[{}]", i.program.table(table), i)

    entries = np.frompyfunc(each, 1, 1)(np.asarray(objects(index), dtype=object))
    return SymbolArray(entries, kind_of(table))


def _index_add(values: Any, axis: int, index: SymbolArray, amount: SymbolArray) -> SymbolArray:
    """The (entries) values, each with the amounts for its index; the only axis is 0."""
    assert axis == 0
    result = np.array(objects(values), dtype=object)
    for i, more in zip(index.values, amount.values, strict=True):
        for entry, value in enumerate(result):
            result[entry] = i.program.line(
                "{0} + {1} if {2} == {3} else {0}", value, more, i, entry
            )
    return SymbolArray(result, kind_of(values))


def _argsort(values: SymbolArray, axis: int = -1, *, stable: bool = True) -> SymbolArray:  # noqa: ARG001
    """Always stable."""
    rows = np.moveaxis(values.values, axis, -1)
    orders = np.empty(rows.shape, dtype=object)
    for row in np.ndindex(rows.shape[:-1]):
        count = rows.shape[-1]
        form = "sorted(range({}), key=(" + "{}, " * count + ").__getitem__)"
        program = _program_of(*rows[row])
        assert program is not None
        order = program.line(form, count, *rows[row])
        for place in range(count):
            orders[(*row, place)] = program.line("{}[{}]", order, place)
    return SymbolArray(np.moveaxis(orders, -1, axis), int)


def _argmax(values: SymbolArray, axis: int) -> SymbolArray:
    def first_of_highest(row: npt.NDArray[Any]) -> Any:
        program, count = _program_of(*row), len(row)
        assert program is not None
        form = "max(range({}), key=(" + "{}, " * count + ").__getitem__)"
        return program.line(form, count, *row)

    rows = np.moveaxis(values.values, axis, -1)
    places = np.empty(rows.shape[:-1], dtype=object)
    for row in np.ndindex(places.shape):
        places[row] = first_of_highest(rows[row])
    return SymbolArray(places, int)


def _where(flag: Any, first: Any, second: Any) -> SymbolArray:
    return _of(_chosen, widest(first, second), flag, first, second)


def _astype(values: SymbolArray, dtype: Any) -> SymbolArray:
    if dtype == np.int64 and values.kind is float:
        return _of(_to_integer, int, values)
    if dtype != np.float64:
        raise UnknownOperationError(f"conversion to {dtype}")
    return values if values.kind is float else _of(_to_float[values.kind], float, values)


_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "any": lambda a, axis, keepdims=False: _reduced(_or, a, axis, keepdims=keepdims),
    "all": lambda a, axis, keepdims=False: _reduced(_and, a, axis, keepdims=keepdims),
    "max": lambda a, axis, keepdims=False: _reduced(_larger, a, axis, keepdims=keepdims),
    "min": lambda a, axis, keepdims=False: _reduced(_smaller, a, axis, keepdims=keepdims),
    "sum": _sum,
    "vecdot": lambda a, b: _sum(a * b, -1),
    "maximum": lambda a, b: _of(_larger, widest(a, b), a, b),
    "minimum": lambda a, b: _of(_smaller, widest(a, b), a, b),
    "where": _where,
    "isnan": lambda a: a != a,
    "sqrt": lambda a: _of(_root, float, a),
    "expm1": lambda a: _of(_exponential_less_one, float, a),
    "concat": _concat,
    "take": _take,
    "index_add": _index_add,
    "argsort": _argsort,
    "argmax": _argmax,
    "astype": _astype,
    "asarray": lambda a, dtype=np.float64, device=None: _astype(a, dtype),  # noqa: ARG005
    "zeros_like": lambda a: np.zeros(a.shape, a.dtype),
    "ones_like": lambda a, dtype=None: np.ones(a.shape, dtype or a.dtype),
    "full_like": lambda a, value: np.full(a.shape, value, a.dtype),
}


LIBRARY: Any = TracingLibrary(_FUNCTIONS)
