"""Episodes of a trained policy, played ahead in the world itself."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from iout_marl.policies.policy import Actions, Policy
from iout_marl.policies.search import Budget
from iout_marl.policies.simulator import Plan, rows
from iout_marl.scenario import Scenario
from iout_marl.world import State, World

Integers = npt.NDArray[np.int64]


class Mirror:
    """Shows a policy a world's states in its mirror images, and turns back what it chooses.

    Args:
        world: the world.
        images: which environment shows which image: (envs, 3) bool, the axes that are reversed.
    """

    def __init__(self, world: World, images: npt.NDArray[np.bool_]) -> None:
        coordinates = world.grid.coordinate_table()
        far = np.array(world.grid.shape) - 1
        steps = np.asarray(world.motion.steps)
        turned = np.where(images[:, None], -steps, steps)
        same_step = (turned[:, :, None] == steps).all(-1)
        mirrored = np.where(images[:, None], far - coordinates, coordinates)
        #: By environment and code, the code of the mirrored cell.
        self._cell: Integers = world.grid.encode(mirrored)
        #: By environment and direction, the mirrored one; where there is none, the direction.
        self._direction: Integers = np.where(
            same_step.any(-1), same_step.argmax(-1), np.arange(len(steps))
        )

    def state(self, state: State) -> State:
        """The states in their images."""
        env = np.arange(len(state.cell))[:, None]
        return state._replace(
            cell=self._cell[env, state.cell], node_cell=self._cell[env, state.node_cell]
        )

    def action(self, action: Actions) -> Actions:
        """What is done in a world is what was chosen in its image."""
        env = np.arange(len(action))[:, None]
        return np.concatenate(
            [self._direction[env, action[..., 0]][..., None], action[..., 1:]], -1
        )


class Rehearsal:
    """Plans by what a trained policy would do: see `BestOf`.

    Args:
        scenario: the scenario.
        policy: has an attribute `sampled`.
        episodes: how many are played in the world as it is, all but the first of drawn actions.
        mirrored: play one in each other mirror image of the world, too.
        seed: of what is drawn.
    """

    def __init__(
        self, scenario: Scenario, policy: Policy, episodes: int, *, mirrored: bool, seed: int
    ) -> None:
        self._policy: Any = policy
        self._seed = seed
        images = list(itertools.product((False, True), repeat=3))[: 8 if mirrored else 1]
        #: Of those before, the most probable actions are taken.
        self._first_drawn = len(images)
        images += [images[0]] * (episodes - 1)
        self._world = World(scenario, len(images), measured=())
        self._mirror = Mirror(self._world, np.array(images))

    def plan(
        self,
        state: State,
        budget: Budget,  # noqa: ARG002 (the number of episodes is the budget)
        warm: Sequence[Policy],  # noqa: ARG002
    ) -> Plan:
        """The best of the episodes from a state of one environment on."""
        world, rng = self._world, np.random.default_rng(self._seed)
        state = rows(state, np.zeros(world.num_envs, dtype=np.int64))
        states, actions = [], []
        for _ in range(max(world.num_slots - int(state.slot[0]), 1)):
            action = self._actions(state, rng)
            states.append(state)
            actions.append(action)
            state, _ = world.step(state, action, world.expected)
        best = int(np.argmin(state.age_sum))
        before = [rows(each, np.array([best])) for each in states]
        together = State(*(np.concatenate(values) for values in zip(*before, strict=True)))
        return Plan(together, np.array(actions)[:, best], float(state.age_sum[best]))

    def _actions(self, state: State, rng: np.random.Generator) -> Actions:
        policy, was_sampled = self._policy, self._policy.sampled
        seen, drawn = self._mirror.state(state), len(state.cell) > self._first_drawn
        try:
            policy.sampled = False
            action = policy.act(self._world, seen, rng)
            if drawn:
                policy.sampled = True
                others = policy.act(self._world, seen, rng)
                action = np.concatenate([action[: self._first_drawn], others[self._first_drawn :]])
        finally:
            policy.sampled = was_sampled
        return self._mirror.action(action.astype(np.int64))
