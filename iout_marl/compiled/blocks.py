"""Which loop does what: the operations of a graph, in blocks one after the other.

A block is a loop over all numbers of arrays of one shape, and inside of it one over the
environments of a tile. What is made and used in one turn is no array, but a number; what is used
later, or in another order, is kept.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from iout_marl.compiled.graph import Node, Operand, Places, unjoined

_T = TypeVar("_T")
#: Sizes of the axes of a loop, outer ones first.
Space: TypeAlias = tuple[int, ...]
#: Numbers of one kind are kept together: floating ones, whole ones, flags.
LETTERS = "fib"
#: The place in memory of a number of an environment, by how an array lies there.
_INDEX = {
    "columns": "({place}) * width + base + lane",
    "rows": "(base + lane) * {row} + {place}",
    "scratch": "({place}) * TILE + lane",
}


@dataclass
class Store:
    """Where the numbers of an array are in memory.

    Attributes:
        array: the name of what they are in, together with others.
        first: the place of the first of them.
        lies: `columns`: an environment after the other, for each number; `rows`: a number after the
            other, for each environment; or `scratch`, columns of a tile.
        row: how many numbers a row has.
    """

    array: str
    first: int
    lies: Literal["columns", "rows", "scratch"] = "columns"
    row: int = 0

    @property
    def is_row(self) -> bool:
        return self.lies == "rows"

    def index(self, place: str) -> str:
        """As source, where in memory the number of a place is."""
        return _INDEX[self.lies].format(place=added(self.first, place), row=self.row)


@dataclass(eq=False)
class Statement:
    """What a block does for each of its places: makes a node, or writes an operand somewhere."""

    space: Space
    node: Node | None = None
    operand: Operand | None = None
    store: Store | None = None
    targets: Places | None = None

    @property
    def is_by_rows(self) -> bool:
        """Whether it reads or writes rows: all numbers of an environment are next to one another.

        Only what is given is read so, and only to be copied.
        """
        return self.store is not None and self.store.is_row


@dataclass
class Block:
    """A loop over a space, by rows or by columns, and what it does in each turn."""

    space: Space
    is_by_rows: bool
    statements: list[Statement] = field(default_factory=list)


class Schedule:
    """The blocks of a program.

    Args:
        given: by name of a parameter: where its numbers are.
        written: arrays and where they go.

    Attributes:
        blocks: in order.
        made: in which block a node is made.
        kept: where a node is kept that is read outside of it or in another order.
        scratch: by letter, how many numbers of each lane are kept in `scratch_f`, and so on.
    """

    def __init__(self, given: dict[str, Store], written: Sequence[tuple[Operand, Store]]) -> None:
        self._given = given
        self.scratch = dict.fromkeys(LETTERS, 0)
        self.blocks: list[Block] = []
        self.made: dict[Node, int] = {}
        self.kept: dict[Node, Store] = {}
        self._place_all(written)

    def _place_all(self, written: Sequence[tuple[Operand, Store]]) -> None:
        needed: set[Node] = set()
        stores = [
            Statement(space_of(target.shape), None, part, store, target)
            for operand, store in written
            for part, target in unjoined(operand, natural(operand.shape))
        ]
        waiting = [present(statement.operand).node for statement in stores]
        while waiting:
            node = waiting.pop()
            if node is not None and node not in needed:
                needed.add(node)
                waiting += [operand.node for operand in node.operands]
        stores = [each for each in stores if not self._settles(each)]
        for node in sorted(needed, key=lambda node: node.number):
            if node.operation == "parameter":
                self._take(node)
            elif node.operation == "concat":
                self._keep(node)
                parts = [
                    Statement(space_of(target.shape), None, part, self.kept[node], target)
                    for part, target in zip(node.operands, node.targets, strict=True)
                ]
                self.made[node] = max(self._place(part) for part in parts)
            else:
                if node.is_reduction or node.operation == "argsort":
                    self._keep(node)
                space = space_of(node.operands[0].shape)
                if node.operation == "argsort":
                    space = space_of(node.shape[:-1])
                self.made[node] = self._place(Statement(space, node))
        for statement in stores:
            self._place(statement)
        self._keep_what_is_read_later()

    def _take(self, node: Node) -> None:
        """Know where a parameter is; one in rows is copied."""
        store = self._given[node.form]
        if store.is_row:
            self._keep(node)
            self.made[node] = self._place(Statement(space_of(node.shape), node, store=store))
        else:
            self.made[node], self.kept[node] = -1, store

    def _settles(self, statement: Statement) -> bool:
        """Let an array that is written as it is be kept where it is written, and read there."""
        operand, store = present(statement.operand), present(statement.store)
        node, order = operand.node, present(statement.targets).ravel()
        if node is None or node in self.kept or store.is_row:
            return False
        if node.operation == "parameter" or operand.places is None:
            return False
        if not _is_natural(operand.places, node.size) or (np.diff(order) != 1).any():
            return False
        self.kept[node] = Store(store.array, store.first + int(order[0]))
        return True

    def scratch_for(self, kind: type, size: int) -> Store:
        """Room for so many numbers of a kind."""
        letter = letter_of(kind)
        self.scratch[letter] += size
        return Store(f"scratch_{letter}", self.scratch[letter] - size, "scratch")

    def _keep(self, node: Node) -> None:
        if node not in self.kept:
            self.kept[node] = self.scratch_for(node.kind, node.size)

    def _place(self, statement: Statement) -> int:
        """Put it into the first block that can do it: its number."""
        first = 0
        for source, is_whole in self._sources(statement):
            if source.node is not None:
                is_near = not is_whole and self.is_local(source, statement)
                first = max(first, self.made[source.node] + (not is_near))
        kind = statement.space, statement.is_by_rows
        for number in range(first, len(self.blocks)):
            block = self.blocks[number]
            if (block.space, block.is_by_rows) == kind:
                block.statements.append(statement)
                return number
        self.blocks.append(Block(*kind, [statement]))
        return len(self.blocks) - 1

    @staticmethod
    def _sources(statement: Statement) -> list[tuple[Operand, bool]]:
        """What a statement reads, and whether it may read any of its numbers in any turn."""
        node = statement.node
        if node is None:
            return [(present(statement.operand), False)]
        return [
            (operand, node.operation == "argsort" or (node.operation == "gather" and i == 1))
            for i, operand in enumerate(node.operands)
        ]

    def is_local(self, operand: Operand, statement: Statement) -> bool:
        """Whether it is the number that the same turn of a loop over the space has made."""
        source = operand.node
        return (
            source is not None
            and not statement.is_by_rows
            and source.operation in ("elementwise", "gather")
            and space_of(source.shape) == statement.space
            and operand.places is not None
            and _is_natural(operand.places, source.size)
        )

    def _keep_what_is_read_later(self) -> None:
        for number, block in enumerate(self.blocks):
            for statement in block.statements:
                for operand, _ in self._sources(statement):
                    if operand.node is None:
                        continue
                    local = self.is_local(operand, statement)
                    if not local or self.made[operand.node] != number:
                        self._keep(operand.node)


def present(value: _T | None) -> _T:
    """What is there: not None."""
    assert value is not None
    return value


def space_of(shape: Sequence[int]) -> Space:
    """The axes of a loop over an array."""
    return tuple(size for size in shape if size != 1)


@functools.lru_cache(maxsize=256)
def natural(shape: tuple[int, ...]) -> Places:
    """The places of an array whose numbers are in their order."""
    return np.arange(math.prod(shape)).reshape(shape)


def _is_natural(places: Places, size: int) -> bool:
    """Whether an array has the numbers of a node in their order, each once."""
    return places.size == size and bool((places.ravel() == np.arange(size)).all())


def added(first: int, place: str) -> str:
    """A place and a number more, as source."""
    if place.isdigit():
        return str(first + int(place))
    return f"{first} + {place}" if first else place


def letter_of(dtype: npt.DTypeLike) -> str:
    """Where numbers of a type are kept."""
    return {"f": "f", "b": "b"}.get(np.dtype(dtype).kind, "i")


def types_kept(dtype: npt.DTypeLike) -> dict[str, np.dtype[Any]]:
    """By letter, the types of numbers where floating ones are of this type."""
    kinds = (dtype, np.int64, np.bool_)
    return {letter: np.dtype(kind) for letter, kind in zip(LETTERS, kinds, strict=True)}
