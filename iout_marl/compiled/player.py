"""A world whose slots are compiled once it pays."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from iout_marl.compiled.choice import SlotChoice
from iout_marl.core.chance import Chance
from iout_marl.core.state import State
from iout_marl.physics.arrays import Array
from iout_marl.world.world import World

if TYPE_CHECKING:
    from iout_marl.compiled.slot import CompiledSlot, Played


class WorldPlayer:
    """Steps, observations and masks of a world, by compiled slots where they pay, else by its own.

    What comes of it is what the world itself would say; observations and masks of a state that a
    step has given are those that have come with it. On libraries other than NumPy it is the world.

    Args:
        world: the world.
        with_mask: whether masks will be asked for.
    """

    def __init__(self, world: World, *, with_mask: bool = False) -> None:
        self._world = world
        self._choice: SlotChoice | None = None
        if world.backend.xp is np:
            self._choice = SlotChoice(
                world.scenario,
                dtype=np.dtype(world.backend.dtype).name,
                with_events=False,
                with_terms=True,
                with_mask=with_mask,
                summed=world.summed,
            )
        self._state: State | None = None
        self._played: Played | None = None

    def step(
        self, state: State, action: Array, chance: Chance | None = None
    ) -> tuple[State, Mapping[str, Array], Array]:
        """One slot: the state after it, the terms of the reward, and the reward.

        Args:
            state, action, chance: as for `World.step`.
        """
        if self._choice is not None and (slot := self._choice.slot()) is not None:
            return self._step_by(slot, state, action, chance)
        started = time.perf_counter()
        after, events = self._world.step(state, action, chance)
        terms = self._world.reward_terms(after, events)
        reward = self._world.total_reward(terms)
        if self._choice is not None:
            self._choice.seconds += time.perf_counter() - started
        return after, terms, reward

    def _step_by(
        self, slot: CompiledSlot, state: State, action: Array, chance: Chance | None
    ) -> tuple[State, Mapping[str, Array], Array]:
        last = self._played_to(state)
        columns = slot.columns(state) if last is None else last.columns
        self._played = played = slot(columns, action, chance)
        self._state = slot.state(played.columns)
        return self._state, played.terms, played.reward

    def _played_to(self, state: State) -> Played | None:
        """What has led to a state, if it was the last slot."""
        return self._played if state is self._state else None

    def observe(self, state: State) -> Array:
        """As `World.observe`."""
        played = self._played_to(state)
        return self._world.observe(state) if played is None else played.observation

    def action_mask(self, state: State) -> Array:
        """As `World.action_mask`."""
        played = self._played_to(state)
        if played is None or not played.mask.size:
            return self._world.action_mask(state)
        return played.mask
