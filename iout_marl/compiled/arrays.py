"""An array library that writes down what is done to its arrays: the nodes of a `Graph`.

Of the array API standard there is what the world asks for; what only builds tables of known
numbers is left to NumPy.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from iout_marl.compiled.graph import Graph, Node, Operand, Places
from iout_marl.tracing.library import (
    KIND_OF,
    TracedArray,
    TracingLibrary,
    UnknownOperationError,
    kind_of,
    widest,
)

#: What changes nothing as an operand of the same kind.
_NEUTRAL: dict[str, Any] = {"{} * {}": 1, "{} & {}": True, "{} | {}": False}
#: Operations whose operands are of kinds of their own; of others all become the widest.
_KINDS_APART = {"select({}, {}, {})"}
#: Operations that make whole numbers of whole ones.
_WHOLE = {
    *("{} + {}", "{} - {}", "{} * {}", "-{}", "{0} * {0}", "select({}, {}, {})"),
    *("larger({}, {})", "smaller({}, {})"),
}


class GraphArray(TracedArray):
    """An array of numbers that are not known yet, of one kind: bool, int or float."""

    def __init__(self, library: GraphLibrary, node: Node, places: Places | None = None) -> None:
        self.library = library
        self.node, self.kind = node, node.kind
        self.places = np.arange(node.size).reshape(node.shape) if places is None else places

    def __array_namespace__(self, api_version: str | None = None) -> Any:
        return self.library

    @property
    def shape(self) -> tuple[int, ...]:
        return self.places.shape

    @property
    def ndim(self) -> int:
        return self.places.ndim

    @property
    def dtype(self) -> np.dtype[Any]:
        return self.library.dtype_of(self.kind)

    def viewed(self, view: Callable[[Any], Any]) -> Any:
        """The array with its numbers moved; known where none is left."""
        places = np.asarray(view(self.places))
        if not places.size:
            return np.zeros(places.shape, self.dtype)
        return GraphArray(self.library, self.node, places)

    def __getitem__(self, key: Any) -> Any:
        return self.viewed(lambda places: places[key])

    def __add__(self, other: Any) -> Any:
        return self.library.computed("{} + {}", None, self, other)

    def __sub__(self, other: Any) -> Any:
        return self.library.computed("{} - {}", None, self, other)

    def __rsub__(self, other: Any) -> Any:
        return self.library.computed("{} - {}", None, other, self)

    def __mul__(self, other: Any) -> Any:
        return self.library.computed("{} * {}", None, self, other)

    def __truediv__(self, other: Any) -> Any:
        return self.library.divided(self, other)

    def __rtruediv__(self, other: Any) -> Any:
        return self.library.divided(other, self)

    def __matmul__(self, other: Any) -> Any:
        """With a vector."""
        if np.ndim(other) != 1:
            raise UnknownOperationError("a product with a matrix on the right")
        return self.library.product(self * other, other, -1)

    def __rmatmul__(self, other: Any) -> Any:
        """The product of a matrix with this one, or with each of several."""
        return self.library.product(self[..., None, :, :] * other[..., None], other, -2)

    def __pow__(self, power: int) -> Any:
        if power != 2:
            raise UnknownOperationError(f"power {power}")
        return self.library.computed("{0} * {0}", None, self)

    def __neg__(self) -> Any:
        return self.library.computed("-{}", None, self)

    def __invert__(self) -> Any:
        return self.library.of_flags("not {}", self)

    def __and__(self, other: Any) -> Any:
        return self.library.of_flags("{} & {}", self, other)

    def __or__(self, other: Any) -> Any:
        return self.library.of_flags("{} | {}", self, other)

    def __lt__(self, other: Any) -> Any:
        return self.library.computed("{} < {}", bool, self, other)

    def __le__(self, other: Any) -> Any:
        return self.library.computed("{} <= {}", bool, self, other)

    def __gt__(self, other: Any) -> Any:
        return self.library.computed("{} > {}", bool, self, other)

    def __ge__(self, other: Any) -> Any:
        return self.library.computed("{} >= {}", bool, self, other)

    def __eq__(self, other: object) -> Any:
        return self.library.computed("{} == {}", bool, self, other)

    def __ne__(self, other: object) -> Any:
        return self.library.computed("{} != {}", bool, self, other)

    __hash__ = None  # type: ignore[assignment]
    __radd__, __rmul__, __rand__, __ror__ = __add__, __mul__, __and__, __or__


class GraphLibrary(TracingLibrary):
    """The library: operations on arrays of a graph; NumPy's where every number is known."""

    def __init__(self, dtype: Any = np.float64) -> None:
        self.graph = Graph(dtype)
        functions: dict[str, Callable[..., Any]] = {
            "sum": self._sum,
            "vecdot": lambda a, b: self.product(a * b, b, -1),
            "maximum": lambda a, b: self.computed("larger({}, {})", None, a, b),
            "minimum": lambda a, b: self.computed("smaller({}, {})", None, a, b),
            "where": self._where,
            "isnan": lambda a: a != a,
            "sqrt": lambda a: self.computed("sqrt({})", float, a),
            "expm1": self._expm1,
            "concat": self._concat,
            "take": self._take,
            "index_add": self._index_add,
            "argsort": self._argsort,
            "argmax": lambda a, axis: self._reduced("argmax", a, axis, kind=int),
            "astype": self._astype,
            "asarray": lambda a, dtype=None, device=None: self._astype(a, dtype),  # noqa: ARG005
            "zeros_like": lambda a, dtype=None: np.zeros(a.shape, dtype or a.dtype),
            "ones_like": lambda a, dtype=None: np.ones(a.shape, dtype or a.dtype),
            "full_like": lambda a, value: np.full(a.shape, value, a.dtype),
        }
        for name in ("any", "all", "max", "min"):
            functions[name] = functools.partial(self._reduced, name)
        super().__init__(functions)

    def dtype_of(self, kind: type) -> np.dtype[Any]:
        """The type of arrays of a kind."""
        return self.graph.dtype if kind is float else np.dtype(kind)

    def parameter(self, name: str, like: npt.NDArray[Any], *, is_whole: bool = False) -> Any:
        """What the program is given, in the shape and of the kind of an array."""
        if not like.size:
            return like
        kind = KIND_OF[like.dtype.kind]
        return GraphArray(self, self.graph.parameter(name, like.shape, kind, is_whole=is_whole))

    def operand(self, array: Any, shape: tuple[int, ...] | None = None) -> Operand:
        """What a node is made of, broadcast to a shape."""
        if isinstance(array, GraphArray):
            operand = Operand(array.node, array.places)
        else:
            operand = Operand(np.asarray(array))
        if shape is None or operand.shape == shape:
            return operand
        return operand.viewed(lambda values: np.broadcast_to(values, shape))

    def computed(self, form: str, kind: type | None, *arrays: Any) -> Any:
        """An elementwise operation; of no kind of its own it has the widest of its operands."""
        kind = widest(*arrays) if kind is None else kind
        shape = np.broadcast_shapes(*(_shape(a) for a in arrays))
        if 0 in shape:
            return np.zeros(shape, self.dtype_of(kind))
        if (same := self._unchanged(form, kind, arrays)) is not None:
            return same.viewed(lambda places: np.broadcast_to(places, shape))
        if form not in _KINDS_APART:
            arrays = tuple(self._cast(a, widest(*arrays)) for a in arrays)
        operands = [self.operand(a, shape) for a in arrays]
        whole = form in _WHOLE
        return GraphArray(self, self.graph.elementwise(form, kind, operands, keeps_whole=whole))

    def _unchanged(self, form: str, kind: type, arrays: tuple[Any, ...]) -> GraphArray | None:
        """The operand that comes out as it is, if one does."""
        neutral = 0 if form == "{} + {}" and kind is int else _NEUTRAL.get(form)
        if neutral is None or len(arrays) != 2:
            return None
        for one, other in (arrays, arrays[::-1]):
            is_one = isinstance(one, GraphArray) and one.kind is kind
            if is_one and not isinstance(other, GraphArray) and np.all(other == neutral):
                return one
        return None

    def divided(self, dividend: Any, divisor: Any) -> Any:
        """A quotient, of floating numbers."""
        both = (self._cast(a, float) for a in (dividend, divisor))
        return self.computed("{} / {}", float, *both)

    def of_flags(self, form: str, *arrays: Any) -> Any:
        if widest(*arrays) is not bool:
            raise UnknownOperationError("an operation on the bits of numbers")
        return self.computed(form, bool, *arrays)

    def _cast(self, array: Any, kind: type) -> Any:
        """Numbers of a kind that is as wide or wider."""
        if not isinstance(array, GraphArray):
            return np.asarray(array).astype(self.dtype_of(kind))
        if array.kind is kind:
            return array
        forms: dict[tuple[type, type], str] = {
            (bool, int): "select({}, 1, 0)",
            (bool, float): "select({}, ONE, ZERO)",
        }
        form = forms.get((array.kind, kind), "real({})")
        node = self.graph.elementwise(form, kind, [self.operand(array)], keeps_whole=True)
        return GraphArray(self, node)

    def _reduced(
        self, name: str, array: Any, axis: int, *, keepdims: bool = False, kind: type | None = None
    ) -> Any:
        moved = array.viewed(lambda places: np.moveaxis(places, axis, -1))
        if not isinstance(moved, GraphArray) or moved.shape[-1] == 0:
            result = getattr(np, name)(np.zeros(array.shape, array.dtype), axis=axis)
            return np.expand_dims(result, axis) if keepdims else result
        if moved.shape[-1] == 1:
            result = moved[..., 0] if name != "argmax" else np.zeros(moved.shape[:-1], np.int64)
        else:
            operand = self.operand(moved)
            result = GraphArray(self, self.graph.reduction(name, kind or array.kind, operand))
        if not keepdims:
            return result
        if not isinstance(result, GraphArray):
            return np.expand_dims(result, axis)
        return result.viewed(lambda places: np.expand_dims(places, axis))

    def _sum(self, array: Any, axis: int, *, keepdims: bool = False) -> Any:
        if not isinstance(array, GraphArray):
            return np.sum(array, axis=axis, keepdims=keepdims)
        array = self._cast(array, int) if array.kind is bool else array
        return self._reduced("sum", array, axis, keepdims=keepdims)

    def product(self, terms: Any, factors: Any, axis: int) -> Any:
        """The sum of terms with some factors, such as that of a matrix and a vector."""
        known = not isinstance(factors, GraphArray)
        count = np.count_nonzero(factors, axis=-1).max() if known else terms.shape[axis]
        if count > 2 and not (isinstance(terms, GraphArray) and terms.node.is_whole):
            # BLAS adds up in an order of its own.
            self.rounds_otherwise()
        return self._sum(terms, axis)

    def _where(self, flag: Any, first: Any, second: Any) -> Any:
        kind = widest(first, second)
        first, second = (self._cast(a, kind) for a in (first, second))
        return self.computed("select({}, {}, {})", kind, flag, first, second)

    def _expm1(self, array: Any) -> Any:
        # Each library has a last digit of its own.
        self.rounds_otherwise()
        return self.computed("expm1({})", float, array)

    def rounds_otherwise(self) -> None:
        """NumPy's last digit may be another: see `physics.arrays.rounds_otherwise`."""
        self.graph.is_exact = False

    def _concat(self, arrays: Sequence[Any], axis: int = 0) -> Any:
        kind = widest(*arrays)
        arrays = [self._cast(a, kind) for a in arrays]
        operands = [self.operand(a) for a in arrays if 0 not in a.shape]
        if not any(isinstance(a, GraphArray) for a in arrays if 0 not in a.shape):
            raise UnknownOperationError("`concat` of arrays of nothing")
        if len(operands) == 1:
            return next(a for a in arrays if 0 not in a.shape)
        return GraphArray(self, *self.graph.concat(operands, kind, axis))

    def _take(self, table: Any, index: Any) -> Any:
        """Numbers of a table of one axis, of which entries or indices, or both, are unknown."""
        if not isinstance(index, GraphArray):
            return table.viewed(lambda places: places[np.asarray(index)])
        kind = kind_of(table)
        known = self._cast(table, kind)
        return GraphArray(self, self.graph.gather(self.operand(known), self.operand(index), kind))

    def _index_add(self, values: Any, axis: int, index: Any, amount: Any) -> Any:
        """The (entries) values, each with the amounts for its index; the only axis is 0."""
        assert axis == 0
        entries = np.arange(values.shape[0])
        for i in range(index.shape[0]):
            more = values + amount[i]
            values = self._where(index[i] == entries, more, values)
        return values

    def _argsort(self, array: Any, axis: int = -1, *, stable: bool = True) -> Any:  # noqa: ARG002
        """Always stable."""
        if array.shape[axis] == 1:
            return np.zeros(array.shape, dtype=np.int64)
        moved = self.operand(array.viewed(lambda places: np.moveaxis(places, axis, -1)))
        return GraphArray(self, self.graph.argsort(moved)).viewed(
            lambda places: np.moveaxis(places, -1, axis)
        )

    def _astype(self, array: Any, dtype: Any) -> Any:
        dtype = self.graph.dtype if dtype is None else np.dtype(dtype)
        if dtype == array.dtype:
            return array
        if dtype == np.int64 and array.kind is float:
            node = self.graph.elementwise("int({})", int, [self.operand(array)])
            return GraphArray(self, node)
        if dtype not in (self.graph.dtype, np.dtype(np.int64)):
            raise UnknownOperationError(f"conversion to {dtype}")
        return self._cast(array, KIND_OF[dtype.kind])


def _shape(array: Any) -> tuple[int, ...]:
    return tuple(array.shape) if isinstance(array, GraphArray) else np.shape(array)
