"""Episodes of a trained policy, played ahead in the world itself."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from iout_marl.policies.policy import Actions, Policy, most_probable
from iout_marl.policies.simulator import Plan, Worlds, joined, played_together, rows, slots_left
from iout_marl.scenario import Scenario
from iout_marl.world import State, World

Integers = npt.NDArray[np.int64]
#: Environments that are played side by side at most.
AT_ONCE = 1024


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
        self._images = np.array(images + [images[0]] * (episodes - 1))
        self._worlds = Worlds(scenario)
        #: By the number of states that are played from together.
        self._mirrors: dict[int, Mirror] = {}

    def plans(self, states: Sequence[State]) -> list[Plan]:
        """The best of the episodes from each of the states, of one environment each."""
        # Of drawn actions, each state has those that it would have alone.
        at_once = max(AT_ONCE // len(self._images), 1) if self._draws_nothing else 1
        plans: dict[int, Plan] = {}
        for group in played_together(states, at_once):
            plans.update(zip(group, self._together([states[i] for i in group]), strict=True))
        return [plans[i] for i in range(len(states))]

    @property
    def _draws_nothing(self) -> bool:
        return len(self._images) == self._first_drawn

    def _together(self, states: Sequence[State]) -> list[Plan]:
        """`plans` of states in the same slot."""
        count, episodes = len(states), len(self._images)
        world = self._worlds.of(count * episodes)
        if count not in self._mirrors:
            self._mirrors[count] = Mirror(world, np.tile(self._images, (count, 1)))
        mirror = self._mirrors[count]
        rng = np.random.default_rng(self._seed)
        every = joined(states)
        state = rows(every, np.repeat(np.arange(count), episodes))
        before, actions = [], []
        for _ in range(slots_left(world, state)):
            action = self._actions(world, mirror, state, rng)
            before.append(state)
            actions.append(action)
            state = self._worlds.step(state, action)
        played = np.array(actions)
        best = state.age_sum.reshape(count, episodes).argmin(-1) + episodes * np.arange(count)
        return [
            Plan(
                joined([rows(each, np.array([env])) for each in before]),
                played[:, env],
                float(state.age_sum[env]),
            )
            for env in best.tolist()
        ]

    def _actions(
        self, world: World, mirror: Mirror, state: State, rng: np.random.Generator
    ) -> Actions:
        policy, seen = self._policy, mirror.state(state)
        with most_probable(policy):
            action = policy.act(world, seen, rng)
            if not self._draws_nothing:
                policy.sampled = True
                others = policy.act(world, seen, rng)
                action = np.concatenate([action[: self._first_drawn], others[self._first_drawn :]])
        return mirror.action(action.astype(np.int64))
