"""How episodes are played: those of a batch by arrays, a single one number by number."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

from iout_marl.compiled import SlotChoice
from iout_marl.tracing.unrolled import Numbers, UnrolledSlot, numbers
from iout_marl.world import Chance, Events, State, World

if TYPE_CHECKING:
    from iout_marl.compiled.slot import CompiledSlot, Played


class Stepper(Protocol):
    """Episodes in the course of being played."""

    @property
    def state(self) -> State:
        """Where they are."""
        ...

    @property
    def events(self) -> Events | None:
        """What happened in the last slot; None before the first one."""
        ...

    def step(
        self, action: npt.NDArray[np.int64], chance: Chance | None = None
    ) -> npt.NDArray[np.float64]:
        """One slot; (envs, auvs) rewards for (envs, auvs, entries) actions."""
        ...

    def observe(self) -> npt.NDArray[np.float32]:
        """(envs, auvs, entries) observations, in a fresh array."""
        ...

    def masks(self) -> npt.NDArray[np.int8]:
        """(envs, auvs, choices): 1 for each sensible choice."""
        ...

    def now(self, name: str) -> npt.NDArray[Any]:
        """An (envs,) array of the state, by name."""
        ...

    def last(self, name: str) -> npt.NDArray[Any]:
        """An (envs, auvs) array of the events, by name."""
        ...

    def first_now(self, name: str) -> Any:
        """The number that `now` has for the first environment."""
        ...

    def first_last(self, name: str) -> list[Any]:
        """The numbers that `last` has for the first environment, (auvs)."""
        ...


class _ByArrays:
    """What is asked for of one environment, from the arrays of all."""

    now: Callable[[str], npt.NDArray[Any]]
    last: Callable[[str], npt.NDArray[Any]]

    def first_now(self, name: str) -> Any:
        return self.now(name).item(0)

    def first_last(self, name: str) -> list[Any]:
        found: list[Any] = self.last(name)[0].tolist()
        return found


class ArrayStepper(_ByArrays):
    """Any number of episodes, by arrays.

    Args:
        world, state, events: of the episodes.
        choice: who wants to know how long it takes.
    """

    def __init__(
        self,
        world: World,
        state: State,
        events: Events | None,
        choice: SlotChoice | None = None,
    ) -> None:
        self._world = world
        self._choice = choice
        self.state, self.events = state, events

    def step(
        self, action: npt.NDArray[np.int64], chance: Chance | None = None
    ) -> npt.NDArray[np.float64]:
        started = time.perf_counter()
        # A copy: events keep what was done, whatever becomes of the caller's array.
        self.state, self.events = self._world.step(self.state, action.copy(), chance)
        reward: npt.NDArray[np.float64] = self._world.reward(self.state, self.events)
        if self._choice is not None:
            self._choice.seconds += time.perf_counter() - started
        return reward

    def observe(self) -> npt.NDArray[np.float32]:
        return _observed(self._world, self.state)

    def masks(self) -> npt.NDArray[np.int8]:
        return _masked(self._world, self.state)

    def now(self, name: str) -> npt.NDArray[Any]:
        array: npt.NDArray[Any] = getattr(self.state, name)
        return array

    def last(self, name: str) -> npt.NDArray[Any]:
        array: npt.NDArray[Any] = getattr(self.events, name)
        return array


class _SlotStepper:
    """Episodes by a slot that takes and gives numbers; arrays are made of what is asked for."""

    def __init__(
        self, slot: Any, world: World, state: State, events: Events | None, now: Any, last: Any
    ) -> None:
        self._slot, self._world = slot, world
        self._state: State | None = state
        self._events = events
        #: The state's numbers, and those of the last slot's events where it has played it.
        self._now, self._last = now, last

    @property
    def state(self) -> State:
        if self._state is None:
            self._state = self._slot.state(self._now)
        return self._state

    @property
    def events(self) -> Events | None:
        if self._events is None and self._last:
            self._events = self._slot.events(self._last)
        return self._events

    def _arrive(self, now: Any, last: Any) -> None:
        self._now, self._last = now, last
        self._state = self._events = None


class CompiledStepper(_SlotStepper, _ByArrays):
    """Any number of episodes, by a compiled slot."""

    def __init__(
        self, slot: CompiledSlot, world: World, state: State, events: Events | None
    ) -> None:
        super().__init__(slot, world, state, events, slot.columns(state), ())
        self._played: Played | None = None
        #: Observations of the last slot, until they are handed out.
        self._seen: npt.NDArray[np.float32] | None = None

    def step(
        self, action: npt.NDArray[np.int64], chance: Chance | None = None
    ) -> npt.NDArray[np.float64]:
        self._played = played = self._slot(self._now, action, chance)
        self._arrive(played.columns, played.columns)
        self._seen = played.observation
        return played.reward

    def observe(self) -> npt.NDArray[np.float32]:
        seen, self._seen = self._seen, None
        return _observed(self._world, self.state) if seen is None else seen

    def masks(self) -> npt.NDArray[np.int8]:
        if self._played is None or not self._played.mask.size:
            return _masked(self._world, self.state)
        return self._played.mask.astype(np.int8)

    def now(self, name: str) -> npt.NDArray[Any]:
        array: npt.NDArray[Any] = self._slot.now(self._now, name)
        return array

    def last(self, name: str) -> npt.NDArray[Any]:
        array: npt.NDArray[Any] = (
            self._slot.last(self._last, name) if self._last else getattr(self._events, name)
        )
        return array


class TracedStepper(_SlotStepper):
    """A single episode, number by number.

    Args:
        slot: plays it.
        world, state, events: of the episode.
        choice: who wants to know how long it takes.
    """

    def __init__(
        self,
        slot: UnrolledSlot,
        world: World,
        state: State,
        events: Events | None,
        choice: SlotChoice | None = None,
    ) -> None:
        self._choice = choice
        last: Numbers = () if events is None else numbers(events)
        super().__init__(slot, world, state, events, numbers(state), last)
        #: Observations and masks, where the last slot has come with them.
        self._seen: Numbers = ()
        self._masks: Numbers = ()

    def step(
        self, action: npt.NDArray[np.int64], chance: Chance | None = None
    ) -> npt.NDArray[np.float64]:
        started = time.perf_counter()
        drawn = () if chance is None else numbers(chance)
        result = self._slot(self._now, action.ravel().tolist(), drawn)
        now, last, rewards, self._seen, self._masks = result
        self._arrive(now, last)
        if self._choice is not None:
            self._choice.seconds += time.perf_counter() - started
        return np.array([rewards])

    def observe(self) -> npt.NDArray[np.float32]:
        if not self._seen:
            return _observed(self._world, self.state)
        return np.array(self._seen, dtype=np.float32).reshape(1, self._world.num_auvs, -1)

    def masks(self) -> npt.NDArray[np.int8]:
        if not self._masks:
            return _masked(self._world, self.state)
        return np.array(self._masks, dtype=np.int8).reshape(1, self._world.num_auvs, -1)

    def now(self, name: str) -> npt.NDArray[Any]:
        return np.array(self._now[self._slot.in_state[name]])

    def last(self, name: str) -> npt.NDArray[Any]:
        return np.array([self._last[self._slot.in_events[name]]])

    def first_now(self, name: str) -> Any:
        return self._now[self._slot.in_state[name]][0]

    def first_last(self, name: str) -> list[Any]:
        return list(self._last[self._slot.in_events[name]])


def _observed(world: World, state: State) -> npt.NDArray[np.float32]:
    return world.observe(state).astype(np.float32, order="C")


def _masked(world: World, state: State) -> npt.NDArray[np.int8]:
    masks: npt.NDArray[np.int8] = world.action_mask(state).astype(np.int8)
    return masks
