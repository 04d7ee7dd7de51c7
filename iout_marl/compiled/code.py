"""Loops in Python, of what a graph says, for a compiler.

A step of one environment becomes a sequence of blocks. A block is a loop over all numbers of arrays
of one shape, or the lines between two loops; what is made and used in one loop is no array, but a
number. So the source does not grow with nodes or AUVs.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from iout_marl.compiled.graph import Graph, Node, Operand, Places, unjoined

#: Sizes of the axes of a loop, outer ones first.
Space: TypeAlias = tuple[int, ...]

#: How a number is added to a result, and what this begins with, by kind.
_REDUCTIONS: dict[str, tuple[str, dict[type, str]]] = {
    "sum": ("{0} + {1}", {int: "0", float: "{zero}"}),
    "max": ("larger({1}, {0})", {int: str(-(2**62)), float: "{least}"}),
    "min": ("smaller({1}, {0})", {int: str(2**62), float: "{most}"}),
    "any": ("{0} | {1}", {bool: "False"}),
    "all": ("{0} & {1}", {bool: "True"}),
    "argmax": ("", {int: "0"}),
}
_LETTER = {bool: "b", int: "i", float: "f"}


@dataclass
class Store:
    """Where the numbers of an array are written for others to read.

    Attributes:
        buffer: how its source begins, up to a place: `out_f[env, `, `scratch_f[`.
        first: the place of the first of them.
        can_be_read: whether they come out as they went in.
    """

    buffer: str
    first: int
    can_be_read: bool = True

    def at(self, place: str) -> str:
        return f"{self.buffer}{_added(self.first, place)}]"


@dataclass(eq=False)
class _Statement:
    """What a block does for each of its places: makes a node, or writes an operand somewhere."""

    space: Space
    node: Node | None = None
    operand: Operand | None = None
    store: Store | None = None
    targets: Places | None = None


@dataclass
class _Block:
    space: Space
    statements: list[_Statement] = field(default_factory=list)


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
    """The source of a step of one environment.

    Args:
        graph: what it does.
        given: by name of a parameter: where its numbers are.
        written: arrays and where they go.

    Attributes:
        lines: the source, in a loop over `env`.
        tables: by letter of a kind, known numbers: of `table_f`, `table_i` and `table_b`.
        scratch: by letter, how many numbers it keeps for itself: in `scratch_f`, and so on.
    """

    def __init__(
        self,
        graph: Graph,
        given: dict[str, Store],
        written: Sequence[tuple[Operand, Store]],
    ) -> None:
        self._graph, self._given = graph, given
        self._dtypes = {"f": graph.dtype, "i": np.dtype(np.int64), "b": np.dtype(np.bool_)}
        self.tables = {letter: Tables(dtype) for letter, dtype in self._dtypes.items()}
        self.scratch = dict.fromkeys("fib", 0)
        self._blocks: list[_Block] = []
        #: In which block a node is made, and whether it is read outside of it or in another order.
        self._made: dict[Node, int] = {}
        self._kept: dict[Node, Store] = {}
        self._schedule(written)
        self.lines = [line for number in range(len(self._blocks)) for line in self._block(number)]

    # Which block does what.

    def _schedule(self, written: Sequence[tuple[Operand, Store]]) -> None:
        needed: set[Node] = set()
        waiting = [operand.node for operand, _ in written]
        while waiting:
            node = waiting.pop()
            if node is not None and node not in needed:
                needed.add(node)
                waiting += [operand.node for operand in node.operands]
        stores = [
            _Statement(_space(target.shape), None, part, store, target)
            for operand, store in written
            for part, target in unjoined(operand, _natural(operand.shape))
        ]
        stores = [each for each in stores if not self._settles(each)]
        read_whole = self._read_whole(needed)
        for node in sorted(needed, key=lambda node: node.number):
            if node.operation == "parameter":
                self._made[node], self._kept[node] = -1, self._given[node.form]
            elif node.operation == "concat":
                self._keep(node)
                parts = [
                    _Statement(_space(target.shape), None, part, self._kept[node], target)
                    for part, target in zip(node.operands, node.targets, strict=True)
                ]
                self._made[node] = max(self._place(part) for part in parts)
            else:
                if node in read_whole:
                    self._keep(node)
                space = _space(node.operands[0].shape)
                if node.operation == "argsort":
                    space = _space(node.shape[:-1])
                self._made[node] = self._place(_Statement(space, node))
        for statement in stores:
            self._place(statement)
        self._keep_what_is_read_later()

    def _settles(self, statement: _Statement) -> bool:
        """Let an array that is written as it is be kept where it is written, and read there."""
        operand, store, targets = statement.operand, statement.store, statement.targets
        assert operand is not None
        assert store is not None
        assert targets is not None
        node, order = operand.node, targets.ravel()
        if node is None or node in self._kept or _is_named(node) or not store.can_be_read:
            return False
        if node.operation == "parameter" or operand.places is None:
            return False
        if not _is_natural(operand.places, node.size) or (np.diff(order) != 1).any():
            return False
        self._kept[node] = Store(store.buffer, store.first + int(order[0]))
        return True

    def _read_whole(self, needed: set[Node]) -> set[Node]:
        """Nodes that are read as tables."""
        return {
            node
            for reader in needed
            for operand in (reader.operands[1:] if reader.operation == "gather" else ())
            + (reader.operands if reader.operation == "argsort" else ())
            if (node := operand.node) is not None
        } | {node for node in needed if node.operation == "argsort"}

    def _keep(self, node: Node) -> None:
        if node not in self._kept and not _is_named(node):
            letter = _LETTER[node.kind]
            self._kept[node] = Store(f"scratch_{letter}[", self.scratch[letter])
            self.scratch[letter] += node.size

    def _place(self, statement: _Statement) -> int:
        """Put it into the first block that can do it: its number."""
        node = statement.node
        operands = node.operands if node is not None else [_given(statement.operand)]
        first = 0
        for i, operand in enumerate(operands):
            source = operand.node
            if source is None or source.operation == "parameter":
                continue
            whole = node is not None and (
                (node.operation == "gather" and i == 1) or node.operation == "argsort"
            )
            made = self._made[source]
            is_near = not whole and self._is_local(source, operand, statement.space)
            first = max(first, made if is_near else made + 1)
        for number in range(first, len(self._blocks)):
            if self._blocks[number].space == statement.space:
                self._blocks[number].statements.append(statement)
                return number
        self._blocks.append(_Block(statement.space, [statement]))
        return len(self._blocks) - 1

    def _is_local(self, source: Node, operand: Operand, space: Space) -> bool:
        """Whether it is the number that the same turn of a loop over the space has made."""
        return (
            source.operation in ("elementwise", "gather")
            and _space(source.shape) == space
            and operand.places is not None
            and _is_natural(operand.places, source.size)
        )

    def _keep_what_is_read_later(self) -> None:
        for number, block in enumerate(self._blocks):
            for statement in block.statements:
                node = statement.node
                operands = node.operands if node is not None else [_given(statement.operand)]
                for operand in operands:
                    source = operand.node
                    if source is None or _is_named(source) or source in self._kept:
                        continue
                    local = self._is_local(source, operand, block.space)
                    if not local or self._made[source] != number:
                        self._keep(source)

    # The source of a block.

    def _block(self, number: int) -> list[str]:
        block, names = self._blocks[number], _Names(number)
        before: list[str] = []
        inside: list[str] = []
        after: list[str] = []
        for statement in block.statements:
            if statement.node is None:
                inside += self._written(statement, number, names)
            elif statement.node.operation in _REDUCTIONS:
                self._reduce(statement.node, number, names, before, inside, after)
            elif statement.node.operation == "argsort":
                inside += self._sorted(statement.node, block.space)
            else:
                inside += self._made_of(statement.node, number, names)
        lines: list[str] = []
        indent, last = "", len(block.space) - 1
        for axis, size in enumerate(block.space):
            if axis == last:
                lines += [indent + line for line in before]
            lines.append(f"{indent}for i{axis} in range({size}):")
            indent += "    "
        lines += [indent + line for line in inside]
        lines += [indent[4:] + line for line in after]
        return lines

    def _made_of(self, node: Node, number: int, names: _Names) -> list[str]:
        lines: list[str] = []
        space = self._blocks[number].space
        if node.operation == "gather":
            index, table = node.operands
            place = self._source(index, number, names, lines)
            expression = self._entry(table, place)
        else:
            read = [self._source(o, number, names, lines) for o in node.operands]
            expression = node.form.format(*read)
        name = f"v{node.number}"
        lines.append(f"{name} = {expression}")
        if node in self._kept:
            target = self._kept[node].at(_place_in(_natural(space), space) or "0")
            lines.append(f"{target} = {name}")
        return lines

    def _entry(self, table: Operand, place: str) -> str:
        """An entry of a table of one axis."""
        node = table.node
        if node is None:
            assert isinstance(table.source, np.ndarray)
            letter = _letter_of(table.source)
            return f"table_{letter}[{_added(self.tables[letter].place(table.source), place)}]"
        if _is_named(node):
            return f"v{node.number}"
        assert table.places is not None
        places = table.places.ravel()
        if places.size > 1 and (np.diff(places) == 1).all():
            return self._kept[node].at(_added(int(places[0]), place))
        index = self.tables["i"].place(places)
        return self._kept[node].at(f"table_i[{_added(index, place)}]")

    def _reduce(
        self,
        node: Node,
        number: int,
        names: _Names,
        before: list[str],
        inside: list[str],
        after: list[str],
    ) -> None:
        (operand,) = node.operands
        space = self._blocks[number].space
        form, starts = _REDUCTIONS[node.operation]
        name = f"v{node.number}"
        start = {"zero": self._literal(0.0), "least": self._literal(-math.inf)}
        start["most"] = self._literal(math.inf)
        before.append(f"{name} = {starts[node.kind].format(**start)}")
        value = self._source(operand, number, names, inside)
        if node.operation == "argmax":
            source = operand.node
            kind = source.kind if source is not None else float
            least = _REDUCTIONS["max"][1][kind].format(**start)
            before.append(f"best_{name} = {least}")
            turn = f"i{len(space) - 1}"
            inside.append(f"{name} = select({value} > best_{name}, {turn}, {name})")
            inside.append(f"best_{name} = larger({value}, best_{name})")
        else:
            inside.append(f"{name} = {form.format(name, value)}")
        if node in self._kept:
            outer = space[:-1]
            target = self._kept[node].at(_place_in(_natural(outer), outer) or "0")
            after.append(f"{target} = {name}")

    def _sorted(self, node: Node, space: Space) -> list[str]:
        (operand,) = node.operands
        count, source = node.shape[-1], operand.node
        assert source is not None
        assert operand.places is not None
        own = self._kept[node]
        row = _place_in(_natural(space) * count, space) or "0"
        places = self.tables["i"].place(operand.places.ravel())
        value = self._kept[source].at(f"table_i[{_added(places, row)} + {{}}]")
        held = own.at(f"{row} + k - 1")
        other = self._kept[source].at(f"table_i[{_added(places, row)} + {held}]")
        name = f"v{node.number}"
        # By insertion, as short as rows are.
        return [
            f"for j in range({count}):",
            f"    {name} = {value.format('j')}",
            "    k = j",
            f"    while k > 0 and {other} > {name}:",
            f"        {own.at(f'{row} + k')} = {held}",
            "        k -= 1",
            f"    {own.at(f'{row} + k')} = j",
        ]

    def _written(self, statement: _Statement, number: int, names: _Names) -> list[str]:
        lines: list[str] = []
        assert statement.store is not None
        assert statement.targets is not None
        value = self._source(_given(statement.operand), number, names, lines)
        space = statement.space
        place = _place_in(statement.targets, space)
        if place is None:
            table = self.tables["i"].place(statement.targets)
            place = f"table_i[{_added(table, _place_in(_natural(space), space) or '0')}]"
        lines.append(f"{statement.store.at(place)} = {value}")
        return lines

    def _source(self, operand: Operand, number: int, names: _Names, lines: list[str]) -> str:
        """The number of an operand in a turn of a block's loop."""
        space, node = self._blocks[number].space, operand.node
        if node is None:
            assert isinstance(operand.source, np.ndarray)
            return self._known(operand.source, space, names, lines)
        assert operand.places is not None
        if self._made[node] == number and self._is_local(node, operand, space):
            return f"v{node.number}"
        if _is_named(node):
            return f"v{node.number}"
        place = _place_in(operand.places, space)
        if place is None:
            table = self.tables["i"].place(operand.places)
            place = f"table_i[{_added(table, _place_in(_natural(space), space) or '0')}]"
        return names.of(self._kept[node].at(place), lines)

    def _known(
        self, values: npt.NDArray[Any], space: Space, names: _Names, lines: list[str]
    ) -> str:
        first = values.ravel()[0]
        if values.size == 1 or values.tobytes() == np.full_like(values, first).tobytes():
            return self._literal(first)
        letter = _letter_of(values)
        place = _place_in(_natural(space), space) or "0"
        return names.of(
            f"table_{letter}[{_added(self.tables[letter].place(values), place)}]", lines
        )

    def _literal(self, value: Any) -> str:
        """A number that all environments share; what scenarios may say stands in a table."""
        value = value.item() if isinstance(value, np.generic) else value
        if isinstance(value, bool):
            return str(value)
        if isinstance(value, int):
            return f"({value})" if value < 0 else str(value)
        if value in (0.0, 1.0) and math.copysign(1.0, value) > 0:
            return {0.0: "ZERO", 1.0: "ONE"}[value]
        return f"table_f[{self.tables['f'].place(np.array([value], self._graph.dtype))}]"


class _Names:
    """Names of what a block reads from memory, once for each turn."""

    def __init__(self, block: int) -> None:
        self._block = block
        self._known: dict[str, str] = {}

    def of(self, source: str, lines: list[str]) -> str:
        if source not in self._known:
            self._known[source] = f"r{self._block}_{len(self._known)}"
            lines.append(f"{self._known[source]} = {source}")
        return self._known[source]


def _is_named(node: Node) -> bool:
    """Whether it is a number between loops, with a name of its own."""
    return node.size == 1 and node.operation not in ("parameter", "concat", "argsort")


def _given(operand: Operand | None) -> Operand:
    assert operand is not None
    return operand


def _letter_of(values: npt.NDArray[Any]) -> str:
    return {"f": "f", "b": "b"}.get(values.dtype.kind, "i")


def _space(shape: Sequence[int]) -> Space:
    """The axes of a loop over an array."""
    return tuple(size for size in shape if size != 1)


@functools.lru_cache(maxsize=256)
def _natural(shape: tuple[int, ...]) -> Places:
    return np.arange(math.prod(shape)).reshape(shape)


def _is_natural(places: Places, size: int) -> bool:
    """Whether an array has the numbers of a node in their order, each once."""
    return places.size == size and bool((places.ravel() == np.arange(size)).all())


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


def _added(first: int, place: str) -> str:
    """A place and a number more, as source."""
    if place.isdigit():
        return str(first + int(place))
    return f"{first} + {place}" if first else place
