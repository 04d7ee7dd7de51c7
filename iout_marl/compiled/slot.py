"""A slot of a batch of environments, compiled: step, reward, observation and mask in one function.

NumPy makes an array of every intermediate result of all environments; here those of a few
environments at a time stay in the cache, and what is done to one is done to several by one
instruction. The world itself is run on arrays that write down what is done to them (`GraphArray`),
so that it is the same world, rule by rule and digit by digit. `benchmarks/compiled.py` measures
what it gains.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from iout_marl.compiled.arrays import GraphArray, GraphLibrary
from iout_marl.compiled.blocks import LETTERS, Store, letter_of, types_kept
from iout_marl.compiled.code import Code
from iout_marl.compiled.module import address_of, compiled_function, is_kept, module_of
from iout_marl.core.chance import Chance, shape_of
from iout_marl.core.limits import unheard
from iout_marl.core.state import Events, State
from iout_marl.errors import InputError
from iout_marl.metrics import Metric
from iout_marl.physics.arrays import Array
from iout_marl.scenario import Scenario
from iout_marl.world.actions import ActionCheck
from iout_marl.world.world import World

#: Fields of a state that are whole numbers as long as no packet counts in part.
_WHOLE = ("age", "deliveries", "seen_age", "seen_slot", "others_age", "others_deliveries")
#: Seconds to compile a line of source.
_LINE_S = 2e-3
#: What names of events and of terms begin with, beside those of the state.
_EVENT, _TERM = "event ", "term "


class Columns(NamedTuple):
    """A state with each environment's numbers in columns, (numbers, envs or a few more).

    Where a slot has led to it, its events, rewards and terms of the reward are in them, too.
    """

    num_envs: int
    made: Mapping[str, npt.NDArray[Any]]  # by letter: floats, integers and flags
    kept: Mapping[str, npt.NDArray[Any]]  # those of fields that no slot changes
    still: Mapping[str, npt.NDArray[Any]]  # these fields


class Played(NamedTuple):
    """What has come of a slot."""

    columns: Columns
    reward: npt.NDArray[Any]  # (envs, auvs)
    terms: Mapping[str, npt.NDArray[Any]]  # (envs, auvs) or, alike for all AUVs, (envs, 1)
    observation: npt.NDArray[Any]  # (envs, auvs, entries)
    mask: npt.NDArray[np.bool_]  # (envs, auvs, choices)


class _Field(NamedTuple):
    """Where an array is in columns."""

    letter: str
    first: int
    shape: tuple[int, ...]  # of one environment


class _Layout:
    """Arrays one after the other in columns of floats, integers and flags."""

    def __init__(self, arrays: Mapping[str, Any], dtype: npt.DTypeLike) -> None:
        self._dtypes = types_kept(dtype)
        self.fields: dict[str, _Field] = {}
        self.sizes = dict.fromkeys(LETTERS, 0)
        for name, array in arrays.items():
            letter = letter_of(array.dtype)
            shape = tuple(array.shape[1:])
            self.fields[name] = _Field(letter, self.sizes[letter], shape)
            self.sizes[letter] += math.prod(shape)

    def empty(self, num_envs: int) -> dict[str, npt.NDArray[Any]]:
        """Columns by letter."""
        width = _width(num_envs)
        return {
            letter: np.empty((size, width), self._dtypes[letter])
            for letter, size in self.sizes.items()
        }

    def view(
        self, name: str, columns: Mapping[str, npt.NDArray[Any]], num_envs: int
    ) -> npt.NDArray[Any]:
        """An array of all environments, in their columns."""
        letter, first, shape = self.fields[name]
        if not shape:
            return columns[letter][first, :num_envs]
        found = columns[letter][first : first + math.prod(shape), :num_envs].T
        return found if len(shape) == 1 else found.reshape(num_envs, *shape)


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
        reward, observation = world.total_reward(terms), world.observe(after)
        self._seen_shape = tuple(observation.shape[1:])
        moving = {
            name: array
            for name, array in after._asdict().items()
            if math.prod(array.shape) and not _is_the_same(array, getattr(before, name))
        }
        self._still = [name for name in State._fields if name not in moving]
        self._terms = list(terms) if with_terms else []
        happened = events._asdict() if with_events else {}
        made = {
            **moving,
            **{_EVENT + name: array for name, array in happened.items()},
            **{_TERM + name: terms[name] for name in self._terms},
            "reward": reward,
        }
        self._made = _Layout(made, dtype)
        self._kept = _Layout({name: state._asdict()[name] for name in self._still}, dtype)
        written = [
            (library.operand(made[name]), Store(f"out_{place.letter}", place.first))
            for name, place in self._made.fields.items()
            if math.prod(place.shape)
        ]
        written.append((library.operand(observation), self._row("seen", observation)))
        #: Shapes of what is drawn for an environment, by name.
        self._drawn_shapes = {name: each.shape[1:] for name, each in drawn.items() if each.size}
        self._nothing = np.empty(0, dtype)
        self._acting = world.num_auvs, world.action_sizes
        #: Of the number of environments that was played last.
        self._checks: dict[int, ActionCheck] = {}
        self._mask_shape: tuple[int, ...] = (0,)
        if with_mask:
            mask = world.action_mask(after)
            self._mask_shape = tuple(mask.shape[1:])
            written.append((library.operand(mask), self._row("mask", mask)))
        given = {
            **{name: Store(f"in_{at.letter}", at.first) for name, at in self._made.fields.items()},
            **{
                name: Store(f"kept_{at.letter}", at.first) for name, at in self._kept.fields.items()
            },
            "action": self._row("action", action),
            **{name: self._row(name, array) for name, array in drawn.items()},
        }
        code = Code(library.graph, given, written)
        self.is_exact = library.graph.is_exact
        self._tables = [code.tables[letter].joined() for letter in LETTERS]
        self._module = module_of(code, self._dtype.name, self._observed.name)
        self._function: Callable[..., None] | None = None
        self._addresses: list[int | None] = []

    @property
    def is_kept(self) -> bool:
        """Whether it was compiled before, and only needs to be read."""
        return is_kept(self._module)

    @property
    def seconds_to_compile(self) -> float:
        """About how long it takes to compile it (`benchmarks/compiled.py`)."""
        return _LINE_S * self._module.source.count("\n")

    def compile(self) -> None:
        """Make it ready to play; where it is kept, that takes no time."""
        self._addresses = [address_of(table) for table in self._tables]
        self._function = compiled_function(self._module)

    def __getstate__(self) -> dict[str, Any]:
        """All but the function: its addresses are those of this one's tables."""
        return vars(self) | {"_function": None, "_addresses": []}

    @staticmethod
    def _row(name: str, array: Array) -> Store:
        return Store(name, 0, "rows", math.prod(array.shape[1:]))

    def columns(self, state: State) -> Columns:
        """A state of the world, on NumPy, in columns."""
        given, num_envs = state._asdict(), len(state.slot)
        made, kept = self._made.empty(num_envs), self._kept.empty(num_envs)
        for layout, columns in ((self._made, made), (self._kept, kept)):
            for name in layout.fields.keys() & given.keys():
                layout.view(name, columns, num_envs)[...] = given[name]
        still = {name: given[name] for name in self._still}
        return Columns(num_envs, made, kept, still)

    def __call__(
        self, columns: Columns, action: npt.NDArray[np.int64], chance: Chance | None
    ) -> Played:
        """One slot.

        Args:
            columns: the state before it.
            action: as for `World.step`.
            chance: as for `World.step`, and drawn.

        Raises:
            InputError: an action that there is not, or chance of another shape.
        """
        if self._function is None:
            self.compile()
        assert self._function is not None
        num_envs = columns.num_envs
        made = self._made.empty(num_envs)
        seen = np.empty((num_envs, *self._seen_shape), self._observed)
        mask = np.empty((num_envs, *self._mask_shape), np.bool_)
        # Arrays have names here, so that they live as long as the function needs them.
        given = [columns.made["f"], columns.made["i"], columns.kept["f"], columns.kept["i"]]
        action = self._checked(action, num_envs)
        drawn = self._drawn(chance, num_envs)
        self._function(
            num_envs,
            _width(num_envs),
            *map(address_of, (*given, action, *drawn)),
            *self._addresses,
            *map(address_of, (*made.values(), seen, mask)),
        )
        terms = {name: self._made.view(_TERM + name, made, num_envs) for name in self._terms}
        reward = self._made.view("reward", made, num_envs)
        after = columns._replace(made=made)
        return Played(after, reward, terms, seen, mask)

    def _checked(self, action: npt.NDArray[np.int64], num_envs: int) -> npt.NDArray[np.int64]:
        """Actions, contiguous: the function would read what is behind its tables for any other."""
        if (check := self._checks.get(num_envs)) is None:
            check = ActionCheck(num_envs, *self._acting)
            self._checks = {num_envs: check}
        return np.ascontiguousarray(check(action))

    def _drawn(self, chance: Chance | None, num_envs: int) -> list[npt.NDArray[Any]]:
        found = dict.fromkeys(Chance._fields, self._nothing)
        for name, shape in self._drawn_shapes.items():
            numbers = None if chance is None else getattr(chance, name)
            if numbers is None or numbers.shape != (num_envs, *shape):
                raise InputError(
                    f"chance: a compiled slot takes {name} of shape {(num_envs, *shape)} that was "
                    f"drawn, not {'None' if numbers is None else numbers.shape}"
                )
            found[name] = np.ascontiguousarray(numbers, self._dtype)
        return list(found.values())

    def state(self, columns: Columns) -> State:
        """The state of these columns, whose arrays are views of them."""
        return State(*(self.now(columns, name) for name in State._fields))

    def events(self, columns: Columns) -> Events:
        """The events of the slot that has led to these columns, whose arrays are views of them."""
        return Events(*(self.last(columns, name) for name in Events._fields))

    def now(self, columns: Columns, name: str) -> npt.NDArray[Any]:
        """A field of the state of these columns."""
        return columns.still[name] if name in self._still else self._view(columns, name)

    def last(self, columns: Columns, name: str) -> npt.NDArray[Any]:
        """A field of the events of the slot that has led to these columns."""
        return self._view(columns, _EVENT + name)

    def _view(self, columns: Columns, name: str) -> npt.NDArray[Any]:
        return self._made.view(name, columns.made, columns.num_envs)


def _width(num_envs: int) -> int:
    """How long columns are: those a power of two apart would push one another out of the cache."""
    return num_envs if num_envs < 64 else -(-num_envs // 16) * 16 + 16


def _is_the_same(array: Array, other: Array) -> bool:
    """Whether a slot leaves a field as it was."""
    if not isinstance(array, GraphArray) or not isinstance(other, GraphArray):
        return array is other
    return array.node is other.node and bool((array.places == other.places).all())
