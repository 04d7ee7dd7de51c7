"""Beam search whose episodes are judged by what a trained policy would make of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from iout_marl.policies.policy import Policy, most_probable
from iout_marl.policies.rehearsal import AT_ONCE, Rehearsal
from iout_marl.policies.simulator import (
    Integers,
    Plan,
    Worlds,
    joined,
    played_together,
    rows,
    slots_left,
)
from iout_marl.scenario import Scenario
from iout_marl.world import State

#: In how many ways every episode that is kept is continued,
CHOICES = 3
#: and for how many slots the policy then plays on, before the best are kept.
AHEAD_SLOTS = 12


class GuidedSearch:
    """Plans by simulation-guided beam search (Choo et al., NeurIPS 2022).

    In every slot each of the episodes that are kept is continued by the policy's most probable
    actions. From each of these the policy plays on for some slots, and those whose ages have then
    come to least are kept.

    Args:
        scenario: the scenario.
        policy: has `likely_actions`, see `trainers.trained.TrainedPolicy`.
        episodes: how many are kept.
    """

    def __init__(self, scenario: Scenario, policy: Policy, episodes: int) -> None:
        self._policy: Any = policy
        self._episodes = episodes
        self._unguided = Rehearsal(scenario, policy, 1, mirrored=False, seed=0)
        self._worlds = Worlds(scenario)

    def plans(self, states: Sequence[State]) -> list[Plan]:
        """The best episode found from each of the states, of one environment each.

        None is worse than what the policy itself plays, by `World.expected` where there is chance.
        """
        plans = self._unguided.plans(states)
        for group in played_together(states, max(AT_ONCE // (self._episodes * CHOICES), 1)):
            found = self._together([states[i] for i in group])
            for i, plan in zip(group, found, strict=True):
                plans[i] = min(plans[i], plan, key=lambda plan: plan.age_sum)
        return plans

    def _together(self, states: Sequence[State]) -> list[Plan]:
        """`plans` of states in the same slot, be they worse than the policy's own."""
        kept = np.repeat(np.arange(len(states)), self._episodes)
        beam, layout = rows(joined(states), kept), kept
        before, actions, parents = [], [], []
        for left in range(slots_left(self._worlds.of(len(beam.cell)), beam), 0, -1):
            likely = self._policy.likely_actions(self._worlds.of(len(beam.cell)), beam, CHOICES)
            parent = np.repeat(np.arange(len(likely)), likely.shape[1])
            action = likely.reshape(-1, *likely.shape[2:])
            after = self._worlds.step(rows(beam, parent), action)
            ages = self._age_sum_ahead(after, min(AHEAD_SLOTS, left - 1))
            kept = self._best(layout[parent], ages, after)
            before.append(beam)
            actions.append(action[kept])
            parents.append(parent[kept])
            beam = rows(after, kept)
        best = beam.age_sum.reshape(len(states), -1).argmin(-1)
        ends = best + self._episodes * np.arange(len(states))
        return [_traced(int(end), before, actions, parents, beam) for end in ends]

    def _age_sum_ahead(self, state: State, slots: int) -> Any:
        """The sums of ages, (envs,), after the policy has played on for so many slots."""
        world, rng = self._worlds.of(len(state.cell)), np.random.default_rng(0)
        with most_probable(self._policy):
            for _ in range(slots):
                state = self._worlds.step(state, self._policy.act(world, state, rng))
        return state.age_sum

    def _best(self, layout: Integers, ages: Any, after: State) -> Integers:
        """Which continuations are kept of each layout, the best first.

        Of those that come to the same state one is kept; fewer than there is room for stand there
        more than once.
        """
        columns = [layout, ages, *(np.asarray(array).reshape(len(ages), -1) for array in after)]
        table = np.column_stack(columns).astype(np.float64)
        distinct = np.unique(table, axis=0, return_index=True)[1]
        return np.concatenate(
            [
                np.resize(distinct[layout[distinct] == each][: self._episodes], self._episodes)
                for each in np.unique(layout)
            ]
        )


def _traced(
    end: int,
    before: Sequence[State],
    actions: Sequence[Integers],
    parents: Sequence[Integers],
    beam: State,
) -> Plan:
    """The plan that ends in a row of the last beam."""
    row, states, done = end, [], []
    for state, action, parent in zip(
        reversed(before), reversed(actions), reversed(parents), strict=True
    ):
        done.append(action[row])
        row = int(parent[row])
        states.append(rows(state, np.array([row])))
    return Plan(joined(states[::-1]), np.array(done[::-1]), float(beam.age_sum[end]))
