"""A scenario's world as planners use it: any number of episodes, played on from any state."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from iout_marl.policies.choice import greedy_action
from iout_marl.scenario import Scenario, load_scenario
from iout_marl.world import State, World

Integers = npt.NDArray[np.int64]

#: How TDD chooses between nodes after each move, see `choose`: all are tried.
URGENCY_EXPONENTS = (1.0, 4.0)


class Plan(NamedTuple):
    """An episode as foreseen, slot by slot."""

    states: State  # before each slot: (slots, …)
    actions: Integers  # (slots, auvs, entries)
    age_sum: float  # at the end, see `State`


class Worlds:
    """A scenario's worlds, by how many episodes are played side by side.

    Args:
        scenario: the scenario.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._known: dict[int, World] = {}

    def of(self, count: int) -> World:
        """The world of so many environments."""
        if count not in self._known:
            self._known[count] = World(self._scenario, count, measured=())
        return self._known[count]

    def step(self, state: State, action: Integers) -> State:
        """The states after one slot, by the rules of `World.step`; of chance, the expected."""
        world = self.of(len(action))
        return world.step(state, action, world.expected)[0]


class Simulator:
    """Plays episodes of a scenario, as many side by side as there are states.

    Args:
        scenario: the scenario.

    Attributes:
        world: its world, with one environment.
        urgency_exponents: how nodes are chosen, see `choose`: one way in FDD, several in TDD.
    """

    def __init__(self, scenario: Scenario) -> None:
        # What is of no matter to a plan costs time in every step.
        unseen: dict[str, Any] = {"observation.view_range_m": None, "observation.entries": []}
        worlds = Worlds(load_scenario(scenario, unseen))
        self.world = worlds.of(1)
        self.urgency_exponents = (
            URGENCY_EXPONENTS if self.world.duplex.num_choices == 1 else URGENCY_EXPONENTS[:1]
        )
        #: The states after one slot, see `Worlds.step`.
        self.step = worlds.step

    def towards(self, state: State, target: Integers) -> Integers:
        """The directions, in the grid, that end nearest to the targets; (envs, auvs) each.

        Of those that are possible in the current, where there is one.
        """
        motion, link = self.world.motion, self.world.link
        offset = link.offset(motion.neighbours(state.cell), target[..., None])
        way_m = link.at(link.way_m, offset)
        return np.where(self.world.manoeuvre.open(state), way_m, np.inf).argmin(-1)

    def actions(self, state: State, direction: Integers) -> Integers:
        """Whole actions after (envs, auvs) directions, (urgency_exponents, envs, auvs, entries)."""
        cell = self.world.manoeuvre.move(state, direction).cell
        nodes = greedy_action(self.world, state, cell, self.urgency_exponents)
        directions = np.broadcast_to(direction[..., None], (*nodes.shape[:-1], 1))
        return np.concatenate([directions, nodes], axis=-1)

    def replay(self, state: State, actions: Integers) -> Plan:
        """The plan that (slots, auvs, entries) actions make from a state of one environment."""
        states = []
        for action in actions:
            states.append(state)
            state = self.step(state, action[None])
        return Plan(joined(states), actions, float(state.age_sum[0]))


def rows(state: State, index: Integers) -> State:
    """The states of those environments."""
    return state.map(lambda array: array[index])


def joined(states: Sequence[State]) -> State:
    """The environments of all states, one after the other."""
    return State(*(np.concatenate(values) for values in zip(*states, strict=True)))


def played_together(states: Sequence[State], at_once: int) -> Iterator[list[int]]:
    """The numbers of those states that can be played on from side by side: of the same slot.

    Args:
        states: of one environment each.
        at_once: how many at most.
    """
    by_slot: dict[int, list[int]] = {}
    for number, state in enumerate(states):
        by_slot.setdefault(int(state.slot[0]), []).append(number)
    for same in by_slot.values():
        for first in range(0, len(same), at_once):
            yield same[first : first + at_once]


def slots_left(world: World, state: State) -> int:
    """How many slots are to be planned from states of one slot; at least one."""
    return max(world.num_slots - int(state.slot[0]), 1)


def with_nodes(state: State, order: Integers) -> State:
    """The state with the nodes in another order, but for what stores have lost."""
    names = ("node_cell", "age", "energy_j", "deliveries")
    return state._replace(**{name: getattr(state, name)[:, order] for name in names})
