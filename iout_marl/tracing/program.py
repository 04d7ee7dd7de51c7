"""Straight-line Python, written line by line.

A line gives a name to the value of an expression; a symbol stands for it in later ones.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt


class Symbol:
    """A number that is not known yet: a name in a program."""

    __slots__ = ("name", "program")

    def __init__(self, program: Program, name: str) -> None:
        self.program = program
        self.name = name


class Program:
    """The lines that lead from parameters to results."""

    def __init__(self) -> None:
        #: By expression: the symbol that stands for it, and the symbols in it.
        self._lines: dict[str, tuple[Symbol, list[Symbol]]] = {}
        self._tables: dict[Any, tuple[str, npt.NDArray[Any]]] = {}

    def parameters(self, name: str, shape: tuple[int, ...]) -> npt.NDArray[Any]:
        """Symbols in an array of that shape, called by a name and their place."""
        values = np.empty(math.prod(shape), dtype=object)
        for i in range(values.size):
            values[i] = Symbol(self, f"{name}_{i}")
        return values.reshape(shape)

    def line(self, form: str, *operands: Any) -> Symbol:
        """The value of an expression, a form with operands in its braces.

        The same expression gives the same symbol.
        """
        expression = form.format(*(_source(each) for each in operands))
        if expression not in self._lines:
            symbol = Symbol(self, f"v{len(self._lines)}")
            self._lines[expression] = symbol, [o for o in operands if isinstance(o, Symbol)]
        return self._lines[expression][0]

    def table(self, values: npt.NDArray[Any]) -> str:
        """The name of a table of known numbers."""
        place = (values.ctypes.data, values.shape, values.strides, values.dtype)
        # Kept along with its array, whose place in memory no other one can take then.
        name, _ = self._tables.setdefault(place, (f"table_{len(self._tables)}", values))
        return name

    def function(
        self, parameters: Sequence[Sequence[Any]], results: Sequence[Sequence[Any]]
    ) -> Callable[..., Any]:
        """A function from a tuple of numbers for each of the parameters to one for each result.

        Lines that no result needs are left out.
        """
        names = [f"parameter_{i}" for i in range(len(parameters))]
        taken = [f"{_tuple(p)} = {n}" for n, p in zip(names, parameters, strict=True) if len(p)]
        needed = {id(each) for result in results for each in result}
        lines = []
        for expression, (symbol, operands) in reversed(self._lines.items()):
            if id(symbol) in needed:
                needed.update(id(operand) for operand in operands)
                lines.append(f"{symbol.name} = {expression}")
        body = [*taken, *reversed(lines), f"return {', '.join(map(_tuple, results))}"]
        source = "\n    ".join([f"def function({', '.join(names)}):", *body])
        # Of a view of memory an entry is a plain number, and nothing is copied.
        scope: dict[str, Any] = {name: table.data for name, table in self._tables.values()}
        scope |= _CALLED
        exec(source, scope)
        function: Callable[..., Any] = scope["function"]
        return function


def _source(operand: Any) -> str:
    if isinstance(operand, Symbol):
        return operand.name
    if isinstance(operand, np.generic):
        operand = operand.item()
    return operand if isinstance(operand, str) else f"({operand!r})"


def _tuple(operands: Sequence[Any]) -> str:
    return f"({''.join(f'{_source(each)}, ' for each in operands)})"


# What NumPy does where Python would raise an error; its own exponential, to the last digit.


def divide(dividend: float, divisor: float) -> float:
    with np.errstate(all="ignore"):
        return float(np.float64(dividend) / np.float64(divisor))


def sqrt(value: float) -> float:
    return math.nan if value < 0 else math.sqrt(value)


#: Up to where e^x is a number.
_LARGEST_EXPONENT = math.log(sys.float_info.max)


def expm1(value: float) -> float:
    return math.inf if value > _LARGEST_EXPONENT else float(np.expm1(value))


#: What expressions call, or Python's way to write a number.
_CALLED = {"inf": math.inf, "nan": math.nan, "divide": divide, "sqrt": sqrt, "expm1": expm1}
