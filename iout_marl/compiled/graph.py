"""What the world does to arrays, written down operation by operation.

A node stands for an array that is not known yet, in as many numbers as one environment has of it.
Views (slices, new axes, transposed or broadcast arrays) are no nodes: they are a node with the
places of its numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

Places: TypeAlias = npt.NDArray[np.int64]

#: From how many numbers on NumPy's sums along the inner axis are not one after the other.
PAIRWISE_FROM = 8
_WITHOUT_REDUCTION = ("parameter", "elementwise", "gather", "concat", "argsort")


@dataclass(eq=False)
class Node:
    """An array that an operation makes.

    Attributes:
        number: nodes count from 0, operands before what is made of them.
        operation: what makes it: `parameter`, `elementwise`, `gather`, `concat`, `argsort`, or the
            name of a reduction of the last axis of its only operand.
        kind: of its numbers: bool, int or float.
        shape: of the array.
        form: an elementwise operation as Python, with braces for its operands; a parameter's name.
        operands: what it is made of; of a gather the indices, and the table that they are of.
        is_whole: whether its numbers are whole, of which sums are exact in any order.
        targets: of a concat: where in it the numbers of each operand are.
    """

    number: int
    operation: str
    kind: type
    shape: tuple[int, ...]
    form: str = ""
    operands: tuple[Operand, ...] = ()
    is_whole: bool = False
    targets: tuple[Places, ...] = field(default=())

    @property
    def size(self) -> int:
        return math.prod(self.shape)

    @property
    def is_reduction(self) -> bool:
        return self.operation not in _WITHOUT_REDUCTION


@dataclass(frozen=True, eq=False)
class Operand:
    """An array that something is made of: numbers of a node, or known ones.

    Attributes:
        source: the node, or the known numbers.
        places: in the array's shape, where in the node each of its numbers is; None of known ones.
    """

    source: Node | npt.NDArray[Any]
    places: Places | None = None

    @property
    def node(self) -> Node | None:
        return self.source if isinstance(self.source, Node) else None

    @property
    def shape(self) -> tuple[int, ...]:
        return self.source.shape if self.places is None else self.places.shape

    @property
    def is_whole(self) -> bool:
        if isinstance(self.source, Node):
            return self.source.is_whole
        if self.source.dtype.kind != "f":
            return True
        return bool((np.isfinite(self.source) & (self.source == np.floor(self.source))).all())

    def key(self) -> Any:
        """What is equal of operands that are."""
        if self.places is None:
            known = np.ascontiguousarray(self.source)
            return known.dtype.char, known.shape, known.tobytes()
        assert isinstance(self.source, Node)
        return self.source.number, self.places.shape, self.places.tobytes()

    def viewed(self, view: Callable[[Any], Any]) -> Operand:
        """The operand with its numbers moved, by a function of arrays."""
        if self.places is None:
            return Operand(view(self.source))
        return Operand(self.source, view(self.places))


class Graph:
    """The nodes of a program.

    Attributes:
        dtype: type of its floating numbers.
        nodes: all of them, each after those that it is made of.
        is_exact: whether its results are NumPy's to the last digit: the order of
            its sums is theirs, or does not matter, and there is no exponential.
    """

    def __init__(self, dtype: Any = np.float64) -> None:
        self.dtype = np.dtype(dtype)
        self.nodes: list[Node] = []
        self.is_exact = True
        self._known: dict[Any, Node] = {}

    def parameter(
        self, name: str, shape: tuple[int, ...], kind: type, *, is_whole: bool = False
    ) -> Node:
        """An array that the program is given."""
        return self._add("parameter", kind, shape, name, (), is_whole=is_whole)

    def elementwise(
        self, form: str, kind: type, operands: Sequence[Operand], *, keeps_whole: bool = False
    ) -> Node:
        """An operation on the numbers of arrays of one shape.

        Args:
            form, kind: see `Node`.
            operands: of this shape.
            keeps_whole: whether it makes whole numbers of such.
        """
        is_whole = kind is not float or (keeps_whole and all(o.is_whole for o in operands))
        shape = operands[0].shape
        return self._add("elementwise", kind, shape, form, operands, is_whole=is_whole)

    def reduction(self, operation: str, kind: type, operand: Operand) -> Node:
        """An operation over the last axis."""
        is_whole = kind is not float or operand.is_whole
        if operation == "sum" and operand.shape[-1] >= PAIRWISE_FROM and not is_whole:
            self.is_exact = False
        return self._add(operation, kind, operand.shape[:-1], "", (operand,), is_whole=is_whole)

    def gather(self, table: Operand, index: Operand, kind: type) -> Node:
        """Numbers of a table, of one axis, at indices."""
        operands, whole = (index, table), table.is_whole
        return self._add("gather", kind, index.shape, "", operands, is_whole=whole)

    def argsort(self, operand: Operand) -> Node:
        """The order of the numbers along the last axis."""
        return self._add("argsort", int, operand.shape, "", (operand,), is_whole=True)

    def concat(self, operands: Sequence[Operand], kind: type, axis: int) -> tuple[Node, Places]:
        """Arrays one after the other: the node, and the places in it of the joined array."""
        shapes = [np.empty(o.shape, dtype=np.bool_) for o in operands]
        shape = np.concatenate(shapes, axis=axis).shape
        places = np.arange(math.prod(shape)).reshape(shape)
        ends = np.cumsum([o.shape[axis] for o in operands])[:-1]
        parts: list[tuple[Operand, Places]] = []
        for operand, target in zip(operands, np.split(places, ends, axis=axis), strict=True):
            parts += unjoined(operand, target)
        whole = all(o.is_whole for o, _ in parts)
        targets = tuple(target for _, target in parts)
        sources = tuple(o for o, _ in parts)
        node = self._add("concat", kind, shape, "", sources, is_whole=whole, targets=targets)
        return node, places

    def _add(
        self,
        operation: str,
        kind: type,
        shape: tuple[int, ...],
        form: str,
        operands: Sequence[Operand],
        *,
        is_whole: bool,
        targets: tuple[Places, ...] = (),
    ) -> Node:
        marks = tuple((target.shape, target.tobytes()) for target in targets)
        key = (operation, kind, shape, form, tuple(o.key() for o in operands), marks)
        if key not in self._known:
            number = len(self.nodes)
            node = Node(
                number, operation, kind, tuple(shape), form, tuple(operands), is_whole, targets
            )
            self.nodes.append(node)
            self._known[key] = node
        return self._known[key]


def unjoined(operand: Operand, target: Places) -> list[tuple[Operand, Places]]:
    """An operand and where its numbers go; of a concat that is used once, those of its parts."""
    node = operand.node
    if node is None or node.operation != "concat" or operand.places is None:
        return [(operand, target)]
    if operand.places.size != node.size or np.unique(operand.places).size != node.size:
        return [(operand, target)]
    goes_to = np.empty(node.size, dtype=np.int64)
    goes_to[operand.places.ravel()] = target.ravel()
    return [(part, goes_to[own]) for part, own in zip(node.operands, node.targets, strict=True)]
