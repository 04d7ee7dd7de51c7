"""A slot of a batch of environments, compiled: step, reward, observation and mask in one loop.

NumPy makes an array of every intermediate result of all environments; here each environment's
numbers lie next to one another, and a slot reads and writes them once. The world itself is run
on arrays that write down what is done to them (`GraphArray`), so that it is the same world, rule by
rule and digit by digit. `benchmarks/compiled.py` measures what it gains.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from iout_marl.compiled.arrays import GraphArray, GraphLibrary
from iout_marl.compiled.code import Code, Store
from iout_marl.compiled.graph import Operand
from iout_marl.compiled.module import compiled_function, is_kept, source_of
from iout_marl.core.chance import Chance, shape_of
from iout_marl.core.limits import unheard
from iout_marl.core.state import Events, State
from iout_marl.metrics import Metric
from iout_marl.physics.arrays import Array
from iout_marl.scenario import Scenario
from iout_marl.world.world import World

#: Fields of a state that are whole numbers as long as no packet counts in part.
_WHOLE = ("age", "deliveries", "seen_age", "seen_slot", "others_age", "others_deliveries")


class Rows(NamedTuple):
    """A state with each environment's numbers in rows, (envs, numbers)."""

    floats: npt.NDArray[Any]
    integers: npt.NDArray[np.int64]
    #: Fields that no slot changes, and the rows of those that it reads.
    still: Mapping[str, npt.NDArray[Any]]


class Played(NamedTuple):
    """What has come of a slot."""

    rows: Rows
    events: tuple[npt.NDArray[Any], ...]  # rows of floats, of integers, of flags
    reward: npt.NDArray[Any]  # (envs, auvs)
    terms: npt.NDArray[Any]  # (envs, terms · auvs or terms)
    observation: npt.NDArray[Any]  # (envs, auvs, entries)
    mask: npt.NDArray[np.bool_]  # (envs, auvs, choices)


class _Field(NamedTuple):
    """Where an array is in rows."""

    letter: str
    first: int
    shape: tuple[int, ...]  # of one environment
    dtype: np.dtype[Any]


class _Layout:
    """Arrays side by side in rows of floats, integers and flags."""

    def __init__(self, arrays: Mapping[str, Any]) -> None:
        self.fields: dict[str, _Field] = {}
        self.sizes = dict.fromkeys("fib", 0)
        for name, array in arrays.items():
            letter = {"f": "f", "b": "b"}.get(array.dtype.kind, "i")
            shape = tuple(array.shape[1:])
            self.fields[name] = _Field(letter, self.sizes[letter], shape, array.dtype)
            self.sizes[letter] += math.prod(shape)

    def view(self, name: str, rows: Mapping[str, npt.NDArray[Any]]) -> npt.NDArray[Any]:
        """An array of all environments, in their rows."""
        field = self.fields[name]
        found = rows[field.letter][:, field.first : field.first + math.prod(field.shape)]
        return found.reshape(len(found), *field.shape)


class CompiledSlot:
    """A slot of a batch, as one compiled function.

    Args:
        scenario: the scenario.
        dtype: floating type of the world.
        observed: that of observations.
        with_events, with_terms, with_mask: what it is to give beside state, reward and observation.
        summed: metrics that are summed over slots, see `World.summed`.

    Attributes:
        is_exact: whether it gives what NumPy gives to the last digit; else sums over nodes, which
            NumPy adds up in an order of its own, may differ in it.

    Raises:
        UnknownOperationError: the scenario does something that cannot be written down.
    """

    @unheard
    def __init__(
        self,
        scenario: Scenario,
        dtype: str = "float64",
        observed: str | None = None,
        *,
        with_events: bool = True,
        with_terms: bool = False,
        with_mask: bool = False,
        summed: tuple[Metric, ...] = (),
    ) -> None:
        library = GraphLibrary(dtype)
        self._dtype = np.dtype(dtype)
        self._observed = np.dtype(observed or dtype)
        world = World(scenario, library=library, dtype=dtype, measured=summed)
        self._num_auvs = world.num_auvs
        state = world.reset(np.zeros((1, world.num_nodes), dtype=np.int64))
        shape = (1, world.num_auvs, len(world.action_sizes))
        action = library.parameter("action", np.zeros(shape, dtype=np.int64))
        before = State(
            *(
                library.parameter(name, np.asarray(array), is_whole=name in _WHOLE)
                for name, array in state._asdict().items()
            )
        )
        drawn = {name: np.zeros(shape_of(name, world.chance, 1)) for name in Chance._fields}
        chance = Chance(*(library.parameter(name, array) for name, array in drawn.items()))
        after, events = world.step(before, action, chance)
        terms = world.reward_terms(after, events)
        #: Of each term of the reward, for how many AUVs it is: 1 for all alike.
        self.terms = {name: int(term.shape[1]) for name, term in terms.items()}
        results = {
            "reward": world.total_reward(terms),
            "observation": world.observe(after),
            **({"mask": world.action_mask(after)} if with_mask else {}),
        }
        self._shapes = {name: tuple(array.shape[1:]) for name, array in results.items()}
        moving = {
            name: array
            for name, array in after._asdict().items()
            if math.prod(array.shape) and not _is_the_same(array, getattr(before, name))
        }
        self._still = [name for name in State._fields if name not in moving]
        self._state = _Layout(moving)
        self._kept = _Layout({name: state._asdict()[name] for name in self._still})
        self._events = _Layout(events._asdict() if with_events else {})
        written = [
            *self._stored(library, moving, self._state, "out"),
            *(
                self._stored(library, events._asdict(), self._events, "event")
                if with_events
                else []
            ),
            (library.operand(results["reward"]), Store("reward[env, ", 0, can_be_read=False)),
            (library.operand(results["observation"]), Store("seen[env, ", 0, can_be_read=False)),
        ]
        self._term_width = 0
        if with_terms:
            for term in terms.values():
                store = Store("terms[env, ", self._term_width, can_be_read=False)
                written.append((library.operand(term), store))
                self._term_width += math.prod(term.shape[1:])
        if with_mask:
            written.append((library.operand(results["mask"]), Store("mask[env, ", 0)))
        given = {
            **self._given(self._state, "in"),
            **self._given(self._kept, "kept"),
            "action": Store("action[env, ", 0),
            **{name: Store(f"{name}[env, ", 0) for name in Chance._fields},
        }
        code = Code(library.graph, given, written)
        self.is_exact = library.graph.is_exact
        self._tables = [code.tables[letter].joined() for letter in "fib"]
        self._dtypes = {"f": self._dtype, "i": np.dtype(np.int64), "b": np.dtype(np.bool_)}
        self._source = source_of(code, self._dtype.name, self._observed.name)
        self._function: Callable[..., None] | None = None

    @property
    def is_kept(self) -> bool:
        """Whether it was compiled before, and only needs to be read."""
        return is_kept(self._source)

    def compile(self) -> None:
        """Make it ready to play, which takes seconds, or where it is kept less than one."""
        self._function = compiled_function(self._source)

    @staticmethod
    def _given(layout: _Layout, name: str) -> dict[str, Store]:
        return {
            field: Store(f"{name}_{place.letter}[env, ", place.first)
            for field, place in layout.fields.items()
        }

    @staticmethod
    def _stored(
        library: GraphLibrary, arrays: Mapping[str, Any], layout: _Layout, name: str
    ) -> list[tuple[Operand, Store]]:
        return [
            (library.operand(arrays[field]), Store(f"{name}_{place.letter}[env, ", place.first))
            for field, place in layout.fields.items()
            if math.prod(place.shape)
        ]

    def rows(self, state: State) -> Rows:
        """A state of the world, on NumPy, in rows."""
        given, num_envs = state._asdict(), len(state.slot)
        parts = self._empty(self._state, num_envs)
        for name in self._state.fields:
            self._state.view(name, parts)[...] = given[name]
        kept = self._empty(self._kept, num_envs)
        for name in self._kept.fields:
            self._kept.view(name, kept)[...] = given[name]
        still = {name: given[name] for name in self._still}
        return Rows(parts["f"], parts["i"], still | {"f": kept["f"], "i": kept["i"]})

    def _empty(self, layout: _Layout, num_envs: int) -> dict[str, npt.NDArray[Any]]:
        return {
            letter: np.empty((num_envs, layout.sizes[letter]), self._dtypes[letter])
            for letter in "fib"
        }

    def __call__(self, rows: Rows, action: npt.NDArray[np.int64], chance: Chance | None) -> Played:
        """One slot.

        Args:
            rows: the state before it.
            action: as for `World.step`.
            chance: as for `World.step`.
        """
        if self._function is None:
            self.compile()
        assert self._function is not None
        num_envs = len(rows.integers)
        after, events = (self._empty(layout, num_envs) for layout in (self._state, self._events))
        reward = np.empty((num_envs, self._num_auvs), self._dtype)
        terms = np.empty((num_envs, self._term_width), self._dtype)
        seen = np.empty((num_envs, math.prod(self._shapes["observation"])), self._observed)
        mask = np.empty((num_envs, math.prod(self._shapes.get("mask", (0,)))), np.bool_)
        self._function(
            num_envs,
            rows.floats,
            rows.integers,
            rows.still["f"],
            rows.still["i"],
            np.ascontiguousarray(action).reshape(num_envs, -1),
            *self._drawn(chance, num_envs),
            *self._tables,
            after["f"],
            after["i"],
            events["f"],
            events["i"],
            events["b"],
            reward,
            terms,
            seen,
            mask,
        )
        return Played(
            Rows(after["f"], after["i"], rows.still),
            (events["f"], events["i"], events["b"]),
            reward,
            terms,
            seen.reshape(num_envs, *self._shapes["observation"]),
            mask.reshape(num_envs, *self._shapes.get("mask", (0,))),
        )

    def _drawn(self, chance: Chance | None, num_envs: int) -> list[npt.NDArray[Any]]:
        if chance is None:
            return [np.empty((num_envs, 0), self._dtype)] * len(Chance._fields)
        # In rows: columns a power of two apart would push one another out of the cache.
        return [
            np.ascontiguousarray(numbers.reshape(num_envs, -1), self._dtype) for numbers in chance
        ]

    def state(self, rows: Rows) -> State:
        """The state of these rows, whose arrays are views of them."""
        return State(*(self.now(rows, name) for name in State._fields))

    def split_terms(self, terms: npt.NDArray[Any]) -> dict[str, npt.NDArray[Any]]:
        """The terms of a reward by name, (envs, auvs) or, alike for all AUVs, (envs, 1) each."""
        ends = itertools.accumulate(self.terms.values(), initial=0)
        columns = itertools.starmap(slice, itertools.pairwise(ends))
        return {name: terms[:, own] for name, own in zip(self.terms, columns, strict=True)}

    def now(self, rows: Rows, name: str) -> npt.NDArray[Any]:
        """A field of the state of these rows."""
        if name not in self._state.fields:
            return rows.still[name]
        return self._state.view(name, {"f": rows.floats, "i": rows.integers})

    def events(self, of: Sequence[npt.NDArray[Any]]) -> Events:
        """The events of these rows, whose arrays are views of them."""
        return Events(*(self.last(of, name) for name in Events._fields))

    def last(self, of: Sequence[npt.NDArray[Any]], name: str) -> npt.NDArray[Any]:
        """A field of the events of these rows."""
        return self._events.view(name, dict(zip("fib", of, strict=True)))


def _is_the_same(array: Array, other: Array) -> bool:
    """Whether a slot leaves a field as it was."""
    if not isinstance(array, GraphArray) or not isinstance(other, GraphArray):
        return array is other
    return array.node is other.node and bool((array.places == other.places).all())
