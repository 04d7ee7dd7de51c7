"""Plans: whole episodes are played in the world before the first slot, the best is kept."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from iout_marl.errors import InputError
from iout_marl.policies.beam import BeamSearch, Weights
from iout_marl.policies.policy import Policy, chosen_by
from iout_marl.policies.routes import Gait, tours
from iout_marl.policies.simulator import (
    Integers,
    Plan,
    Simulator,
    rows,
    slots_left,
    with_nodes,
)
from iout_marl.scenario import Scenario
from iout_marl.world import State, World

#: Episodes played side by side, and choices of nodes after each move: at first,
FIRST_SEARCH = (384, 1)
#: and in every round.
ROUND_SEARCH = (4608, 3)
#: The share of rounds that begin with the first slot, and of those that keep the best plan.
FROM_START, KEEPING = 0.4, 0.65
#: So many rounds all begin with the first slot.
EARLY_ROUNDS = 3
#: The share of rounds with weights that are wholly new, and how far they and others stray.
AFRESH, FAR_OCTAVES, NEAR_OCTAVES = 0.2, 1.0, 0.4


@dataclass(frozen=True)
class Budget:
    """How long to search: for so many rounds, or as many as begin within so many seconds.

    Plans of the same seed and the same number of rounds are the same. Seconds only decide how
    many rounds are done, which differs from machine to machine, and from run to run.

    Attributes:
        rounds: beam searches; 0 leaves it at the first.
        seconds: time for all rounds; the last is finished, however long it takes.

    Raises:
        InputError: less than 0, or not just one of rounds and seconds.
    """

    rounds: int | None = None
    seconds: float | None = None

    def __post_init__(self) -> None:
        if (self.rounds is None) == (self.seconds is None):
            raise InputError("a planner's budget is either rounds or seconds")
        if self.rounds is not None and self.rounds < 0:
            raise InputError(f"a planner's rounds must not be negative, not {self.rounds}")
        if self.seconds is not None and not 0 <= self.seconds < math.inf:
            raise InputError(f"a planner's seconds must be 0 or more, not {self.seconds}")

    def shared(self, plans: int) -> Budget:
        """The share of each of several plans."""
        if self.rounds is not None:
            return Budget(rounds=self.rounds // plans)
        return Budget(seconds=(self.seconds or 0) / plans)

    def turns(self) -> Iterator[int]:
        """Counts rounds, from 0, until the budget is spent."""
        begun, turn = time.monotonic(), 0
        while self._allows(turn, time.monotonic() - begun):
            yield turn
            turn += 1

    def _allows(self, rounds: int, seconds: float) -> bool:
        if self.rounds is not None:
            return rounds < self.rounds
        return self.seconds is not None and seconds < self.seconds


#: What a planner spends unless told otherwise: a few seconds.
DEFAULT_BUDGET = Budget(rounds=3)


class Planner:
    """Plans episodes of a scenario, from any state of one environment.

    First the AUVs go round tours of several reaches. Then, if it searches, a beam search
    looks for something better. Every round of the budget is one more, and wider: with other
    weights and other chance, from the first slot or from any other slot of the best plan so
    far, with that plan in the beam or without. Weights that have led to a better plan are
    those that the next vary.

    Args:
        scenario: the scenario.
        searches: whether it searches beyond the tours.
        seed: of whatever the search leaves to chance.
    """

    def __init__(self, scenario: Scenario, *, searches: bool, seed: int = 0) -> None:
        self._scenario = scenario
        self._searches = searches
        self._seed = seed
        self._simulator = simulator = Simulator(scenario)
        self._first = BeamSearch(simulator, *FIRST_SEARCH)
        self._wide = BeamSearch(simulator, *ROUND_SEARCH)

    def plan(
        self, state: State, budget: Budget = DEFAULT_BUDGET, warm: Sequence[Policy] = ()
    ) -> Plan:
        """The best episode found from a state of one environment on.

        Args:
            state: the state.
            budget: how long to search.
            warm: policies; the plan is no worse than the episodes that they play from here.
        """
        # Nodes in the order of their cells: that in which they are named must not matter.
        order = state.node_cell[0].argsort(kind="stable")
        back = order.argsort(kind="stable")
        start, routes = with_nodes(state, order), self._tours(state)
        # Behind all nodes: nobody, whom a policy may name (`auvs.idle_choices`).
        order_named, back_named = (np.append(each, len(each)) for each in (order, back))
        plans = [self._simulator.replay(start, self._follow(start, routes))]
        for policy in warm:
            actions = self._played(state, policy)
            actions[..., 1:] = back_named[actions[..., 1:]]
            plans.append(self._simulator.replay(start, actions))
        plan = min(plans, key=lambda plan: plan.age_sum)
        if self._searches:
            plan = self._improve(plan, routes, budget)
        actions = plan.actions.copy()
        actions[..., 1:] = order_named[actions[..., 1:]]
        return Plan(with_nodes(plan.states, back), actions, plan.age_sum)

    def _tours(self, state: State) -> Integers:
        """(tours, slots, auvs) codes of the cells that AUVs go to."""
        world = self._simulator.world
        table = world.grid.coordinate_table()
        motion = world.motion
        routes = tours(
            table[np.sort(state.node_cell[0])],
            table[motion.heading(state)[0]],
            slots_left(world, state),
            world.grid.shape,
            Gait(world.scenario.auvs.motion.part.can_rest, *motion.pace.along_axes(motion.steps)),
            state.transit_slots[0] if motion.takes_slots else 0,
        )
        return world.grid.encode(routes)

    def _follow(self, state: State, routes: Integers) -> Integers:
        """The actions, (slots, auvs, entries), along the tour that comes out best."""
        count, num_hastes = len(routes), len(self._simulator.urgency_exponents)
        state = rows(state, np.zeros(count * num_hastes, dtype=np.int64))
        cells = np.tile(routes, (num_hastes, 1, 1))
        # The same haste through the whole episode.
        which = np.arange(len(cells)) // count, np.arange(len(cells))
        actions = []
        for slot in range(cells.shape[1]):
            direction = self._simulator.towards(state, cells[:, slot])
            action = self._simulator.actions(state, direction)[which]
            actions.append(action)
            state = self._simulator.step(state, action)
        return np.array(actions)[:, int(state.age_sum.argmin())]

    def _played(self, state: State, policy: Policy) -> Integers:
        """The actions, (slots, auvs, entries), of a policy from a state on."""
        world, rng = World(self._scenario), np.random.default_rng(self._seed)
        actions = []
        for _ in range(slots_left(world, state)):
            actions.append(chosen_by(policy, world, state, rng))
            state, _ = world.step(state, actions[-1], world.expected)
        return np.concatenate(actions).astype(np.int64)

    def _improve(self, plan: Plan, routes: Integers, budget: Budget) -> Plan:
        """The best plan of the first search and all rounds."""
        rng = np.random.default_rng(self._seed)
        usual = good = Weights.usual(self._simulator)
        start = _before(plan, 0)
        found = self._first.search(start, self._cells(plan), usual, rng)
        plan = min(plan, self._simulator.replay(start, found), key=lambda plan: plan.age_sum)
        for turn in budget.turns():
            afresh, keeps = rng.random(2) < (AFRESH, KEEPING)
            weights = usual.varied(rng, FAR_OCTAVES) if afresh else good.varied(rng, NEAR_OCTAVES)
            slot = int(rng.integers(len(plan.actions)))
            if turn < EARLY_ROUNDS or rng.random() < FROM_START:
                slot = 0
            route = self._cells(plan) if slot or keeps else routes[rng.integers(len(routes))]
            known = plan.actions[slot:] if keeps else None
            found = self._wide.search(_before(plan, slot), route[slot:], weights, rng, known)
            found = np.concatenate([plan.actions[:slot], found])
            other = self._simulator.replay(start, found)
            if other.age_sum < plan.age_sum:
                plan, good = other, weights
        return plan

    def _cells(self, plan: Plan) -> Integers:
        """(slots, auvs) cells that AUVs go to in each slot; in the last as in the one before."""
        cells = self._simulator.world.motion.heading(plan.states)
        return np.concatenate([cells[1:], cells[-1:]])


def _before(plan: Plan, slot: int) -> State:
    """The state of one environment before a slot of the plan."""
    return rows(plan.states, np.array([slot]))
