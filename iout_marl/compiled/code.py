"""Loops in Python, of what a graph says, for a compiler.

A step of a tile of environments is a sequence of blocks. A block is a loop over all numbers of
arrays of one shape, and inside of it one over the environments of the tile, its lanes: what is done
to a number is done to that of all lanes, which lie side by side, by vector instructions. So the
source does not grow with nodes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from iout_marl.compiled.blocks import (
    Block,
    Schedule,
    Space,
    Statement,
    Store,
    added,
    letter_of,
    natural,
    present,
    types_kept,
)
from iout_marl.compiled.graph import Graph, Operand, Places

#: How a number is added to a result, and what this begins with, by kind.
_REDUCTIONS: dict[str, tuple[str, dict[type, str]]] = {
    "sum": ("{0} + {1}", {int: "0", float: "{zero}"}),
    "max": ("larger({1}, {0})", {bool: "False", int: str(-(2**62)), float: "{least}"}),
    "min": ("smaller({1}, {0})", {bool: "True", int: str(2**62), float: "{most}"}),
    "any": ("{0} | {1}", {bool: "False"}),
    "all": ("{0} & {1}", {bool: "True"}),
    "argmax": ("", {int: "0"}),
}


class Tables:
    """Known numbers that a program reads, of one kind, one after the other."""

    def __init__(self, dtype: Any) -> None:
        self._dtype = np.dtype(dtype)
        self._arrays: list[npt.NDArray[Any]] = []
        self._places: dict[Any, int] = {}
        self._end = 0

    def place(self, values: npt.NDArray[Any]) -> int:
        """Where they are: the place of the first."""
        values = np.ascontiguousarray(values, dtype=self._dtype).ravel()
        key = values.tobytes()
        if key not in self._places:
            self._places[key] = self._end
            self._arrays.append(values)
            self._end += values.size
        return self._places[key]

    def joined(self) -> npt.NDArray[Any]:
        """All of them."""
        return np.concatenate([np.zeros(0, self._dtype), *self._arrays])


class Code:
    """The source of a step of a tile of environments.

    Args:
        graph: what it does.
        given: by name of a parameter: where its numbers are.
        written: arrays and where they go.

    Attributes:
        lines: the source, for environments from `base` on, as many as `lanes`.
        tables: by letter of a kind, known numbers: of `table_f`, `table_i` and `table_b`.
        scratch: by letter, how many numbers of each lane it keeps for itself: in `scratch_f`, and
            so on.
    """

    def __init__(
        self,
        graph: Graph,
        given: dict[str, Store],
        written: Sequence[tuple[Operand, Store]],
    ) -> None:
        self._graph = graph
        self.tables = {letter: Tables(dtype) for letter, dtype in types_kept(graph.dtype).items()}
        self._schedule = Schedule(given, written)
        self.scratch = self._schedule.scratch
        blocks = self._schedule.blocks
        self.lines = [line for number in range(len(blocks)) for line in self._block(number)]

    def _block(self, number: int) -> list[str]:
        block = self._schedule.blocks[number]
        loop = _Loop(number)
        for statement in block.statements:
            node = statement.node
            if node is None:
                self._written(statement, loop)
            elif node.operation == "parameter":
                self._copied(statement, loop)
            elif node.is_reduction:
                self._reduce(statement, loop)
            elif node.operation == "argsort":
                self._sorted(statement, loop)
            else:
                self._made_of(statement, loop)
        return loop.lines(block)

    def _made_of(self, statement: Statement, loop: _Loop) -> None:
        node, space = present(statement.node), statement.space
        if node.operation == "gather":
            index, table = node.operands
            expression = self._entry(table, self._source(index, statement, loop))
        else:
            read = [self._source(operand, statement, loop) for operand in node.operands]
            expression = node.form.format(*read)
        name = f"v{node.number}"
        loop.inside.append(f"{name} = {expression}")
        if node in self._schedule.kept:
            loop.inside.append(_put(self._schedule.kept[node], _turn(space), name))

    def _copied(self, statement: Statement, loop: _Loop) -> None:
        node, turn = present(statement.node), _turn(statement.space)
        value = _get(present(statement.store), turn)
        loop.inside.append(_put(self._schedule.kept[node], turn, value))

    def _entry(self, table: Operand, place: str) -> str:
        """An entry of a table of one axis."""
        node = table.node
        if node is None:
            assert isinstance(table.source, np.ndarray)
            return self._number(table.source, place)
        assert table.places is not None
        places = table.places.ravel()
        if (np.diff(places) == 1).all():
            return _get(self._schedule.kept[node], added(int(places[0]), place))
        return _get(self._schedule.kept[node], self._number(places, place))

    def _number(self, values: npt.NDArray[Any], place: str) -> str:
        """One of known numbers, by its place."""
        letter = letter_of(values.dtype)
        return f"get(table_{letter}, {added(self.tables[letter].place(values), place)})"

    def _reduce(self, statement: Statement, loop: _Loop) -> None:
        node, space = present(statement.node), statement.space
        form, starts = _REDUCTIONS[node.operation]
        start = {"zero": self._literal(0.0), "least": self._literal(-math.inf)}
        start["most"] = self._literal(math.inf)
        (operand,) = node.operands
        store, outer = self._schedule.kept[node], _turn(space[:-1])
        loop.before.append(_put(store, outer, starts[node.kind].format(**start)))
        value, sofar = self._source(operand, statement, loop), _get(store, outer)
        if node.operation != "argmax":
            loop.inside.append(_put(store, outer, form.format(sofar, value)))
            return
        kind = operand.node.kind if operand.node is not None else float
        best, turn = self._schedule.scratch_for(kind, node.size), f"i{len(space) - 1}"
        loop.before.append(_put(best, outer, _REDUCTIONS["max"][1][kind].format(**start)))
        name = f"best_v{node.number}"
        loop.inside += [
            f"{name} = {_get(best, outer)}",
            _put(store, outer, f"select(after({value}, {name}), {turn}, {sofar})"),
            _put(best, outer, f"select(after({value}, {name}), {value}, {name})"),
        ]

    def _sorted(self, statement: Statement, loop: _Loop) -> None:
        node, space = present(statement.node), statement.space
        (operand,) = node.operands
        assert operand.node is not None
        assert operand.places is not None
        own, source, count = (
            self._schedule.kept[node],
            self._schedule.kept[operand.node],
            node.shape[-1],
        )
        row = _place_in(natural(space) * count, space)
        assert row is not None

        def value(entry: str) -> str:
            place = self._number(present(operand.places).ravel(), f"{row} + {entry}")
            return _get(source, place)

        name, held = f"v{node.number}", _get(own, f"{row} + k - 1")
        # By insertion, as short as rows are.
        loop.inside += [
            f"for j in range({count}):",
            f"    {name} = {value('j')}",
            "    k = j",
            f"    while k > 0 and after({value(held)}, {name}):",
            f"        {_put(own, f'{row} + k', held)}",
            "        k -= 1",
            f"    {_put(own, f'{row} + k', 'j')}",
        ]

    def _written(self, statement: Statement, loop: _Loop) -> None:
        value = self._source(present(statement.operand), statement, loop)
        place = self._place_of(present(statement.targets), statement.space)
        loop.inside.append(_put(present(statement.store), place, value))

    def _place_of(self, places: Places, space: Space) -> str:
        """One of places, in a turn of a loop over them."""
        place = _place_in(places, space)
        return self._number(places, _turn(space)) if place is None else place

    def _source(self, operand: Operand, statement: Statement, loop: _Loop) -> str:
        """The number of an operand in a turn of a statement's loop."""
        node = operand.node
        if node is None:
            assert isinstance(operand.source, np.ndarray)
            return self._known(operand.source, statement.space, loop)
        if self._schedule.made[node] == loop.number and self._schedule.is_local(operand, statement):
            return f"v{node.number}"
        place = self._place_of(present(operand.places), statement.space)
        return loop.named(_get(self._schedule.kept[node], place))

    def _known(self, values: npt.NDArray[Any], space: Space, loop: _Loop) -> str:
        first = values.ravel()[0]
        if values.size == 1 or values.tobytes() == np.full_like(values, first).tobytes():
            return self._literal(first)
        return loop.named(self._number(values, _turn(space)))

    def _literal(self, value: Any) -> str:
        """A number that all environments share; what scenarios may say stands in a table."""
        value = value.item() if isinstance(value, np.generic) else value
        if isinstance(value, bool):
            return str(value)
        if isinstance(value, int):
            return f"({value})" if value < 0 else str(value)
        if value in (0.0, 1.0) and math.copysign(1.0, value) > 0:
            return {0.0: "ZERO", 1.0: "ONE"}[value]
        return self._number(np.array([value], self._graph.dtype), "0")


class _Loop:
    """What a block does in each turn.

    Attributes:
        number: of the block.
        before: lines that come before its inner axis, in a loop over lanes of their own.
        inside: lines of each turn.
    """

    def __init__(self, number: int) -> None:
        self.number = number
        self.before: list[str] = []
        self.inside: list[str] = []
        self._names: dict[str, str] = {}

    def lines(self, block: Block) -> list[str]:
        """The source."""
        lanes = "for lane in range(lanes):"
        axes = [f"for i{axis} in range({size}):" for axis, size in enumerate(block.space)]
        if block.is_by_rows:
            return _nested([lanes, *axes], self.inside)
        before = _nested([lanes], self.before) if self.before else []
        return _nested(axes[:-1], [*before, *_nested([*axes[-1:], lanes], self.inside)])

    def named(self, source: str) -> str:
        """The name of what is read from memory, once for each turn."""
        if source not in self._names:
            self._names[source] = f"r{self.number}_{len(self._names)}"
            self.inside.append(f"{self._names[source]} = {source}")
        return self._names[source]


def _get(store: Store, place: str) -> str:
    """A number that is kept."""
    return f"get({store.array}, {store.index(place)})"


def _put(store: Store, place: str, value: str) -> str:
    """Keep a number."""
    return f"put({store.array}, {store.index(place)}, {value})"


def _nested(loops: Sequence[str], lines: list[str]) -> list[str]:
    for loop in reversed(loops):
        lines = [loop, *("    " + line for line in lines)]
    return lines


def _turn(space: Space) -> str:
    """The place of a turn of a loop."""
    place = _place_in(natural(space), space)
    assert place is not None
    return place


def _place_in(places: Places, space: Space) -> str | None:
    """The places of an array, in a loop over it; None where they are no sum of steps."""
    places = places.reshape(space)
    first = int(places.flat[0]) if places.size else 0
    steps = [int(np.take(places, 1, axis).flat[0]) - first for axis in range(places.ndim)]
    regular = np.full(places.shape, first)
    for axis, step in enumerate(steps):
        along = [1] * places.ndim
        along[axis] = places.shape[axis]
        regular = regular + step * np.arange(places.shape[axis]).reshape(along)
    if (regular != places).any():
        return None
    terms = [
        f"i{axis}" if step == 1 else f"{step} * i{axis}" for axis, step in enumerate(steps) if step
    ]
    return " + ".join([*terms, *([str(first)] if first or not terms else [])])
