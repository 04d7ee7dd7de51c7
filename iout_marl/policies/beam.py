"""Beam search: in every slot many ways to continue are played, the most promising are kept."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from iout_marl.policies.choice import links, near_uplink_j
from iout_marl.policies.simulator import Integers, Simulator, rows
from iout_marl.world import State

Floats = npt.NDArray[np.float64]

#: Moves of several AUVs tried from each episode; a lone one tries every direction.
MOVES = 12
#: Spread of the logarithm of ages where nodes are chosen by chance.
NOISE = 0.7
#: Towards the end of an episode stores lose their worth, in proportion to the slots left.
STORES_LAST_SLOTS = 6.0


class Weights(NamedTuple):
    """What an unfinished episode is judged by, besides the ages that it has had."""

    lasting_slots: float  # for how many slots each age will count on
    lacking_slots: float  # up to how many more, one for each slot of charging that is lacking
    store_slots: float  # for how many slots of age a store e times as large makes up

    @classmethod
    def usual(cls, simulator: Simulator) -> Weights:
        """What serves well in most worlds."""
        return cls(3.0, 3.0, 0.3 if simulator.world.duplex.num_choices == 1 else 1.5)

    def varied(self, rng: np.random.Generator, octaves: float) -> Weights:
        """Each weight up or down by a random factor; a standard deviation of so many octaves."""
        return Weights(*(float(weight * 2 ** rng.normal(0, octaves)) for weight in self))


class BeamSearch:
    """Beam search for the episode of the lowest ages.

    From every episode that is kept several moves of the fleet are tried. After each, the
    nodes are chosen by `choose`: once by the ages as they are, then by ages multiplied by
    random factors. Half of the moves of several AUVs go along a route.

    Args:
        simulator: the world.
        episodes: how many are played side by side.
        choices: how often nodes are chosen after each move; a fleet's moves are drawn anew
            for each.
    """

    def __init__(self, simulator: Simulator, episodes: int, choices: int) -> None:
        self._simulator = simulator
        self._choices = choices
        world = simulator.world
        self._directions = world.motion.num_directions
        self._moves = self._directions if world.num_auvs == 1 else MOVES
        ways = self._moves * choices
        self._width = max(episodes // (ways * len(simulator.urgency_exponents)), 1)
        self._parent = np.repeat(np.arange(self._width), ways)
        self._parents = np.tile(self._parent, len(simulator.urgency_exponents))

    def search(
        self,
        state: State,
        route: Integers,
        weights: Weights,
        rng: np.random.Generator,
        known: Integers | None = None,
    ) -> Integers:
        """The actions of the best episode found, (slots, auvs, entries).

        Args:
            state: where to begin: the state of one environment.
            route: (slots, auvs) cells, for as many slots as are to be planned.
            weights: what unfinished episodes are judged by.
            rng: the stream for whatever is left to chance.
            known: (slots, auvs, entries) actions that are kept in the beam throughout: what
                is found will be no worse.
        """
        beam = rows(state, np.zeros(self._width, dtype=np.int64))
        actions, parents = [], []
        for slot, cells in enumerate(route):
            action = self._expand(rows(beam, self._parent), cells, rng)
            if known is not None:
                # The first child of the first episode.
                action[0] = known[slot]
            after = self._simulator.step(rows(beam, self._parents), action)
            score = self._score(after, weights, len(route) - slot - 1)
            if known is not None:
                score[0] = -np.inf
            distinct = self._distinct(score, after)
            kept = np.resize(distinct[: self._width], self._width)
            actions.append(action[kept])
            parents.append(self._parents[kept])
            beam = rows(after, kept)
        child, found = int(beam.age_sum.argmin()), []
        for action, parent in zip(reversed(actions), reversed(parents), strict=True):
            found.append(action[child])
            child = int(parent[child])
        return np.array(found[::-1])

    def _distinct(self, score: Floats, after: State) -> Integers:
        """The best episode first; those that come to the same by other ways are one."""
        motion, keys = self._simulator.world.motion, score.round(6)
        if not motion.takes_slots:
            return np.unique(keys, return_index=True)[1]
        # AUVs that have set off for different cells are still in the same.
        headed = [motion.heading(after), after.transit_slots]
        keys = np.concatenate([keys[:, None], *headed], axis=1)
        return np.unique(keys, axis=0, return_index=True)[1]

    def _expand(self, before: State, cells: Integers, rng: np.random.Generator) -> Integers:
        """The actions to try in a slot, (exponents · width · moves · choices, auvs, entries)."""
        direction = self._moves_near(before, cells, rng)
        if self._choices > 1:
            factor = np.exp(NOISE * rng.standard_normal(before.age.shape))
            factor[:: self._choices] = 1
            before = before._replace(age=before.age * factor)
        action = self._simulator.actions(before, direction)
        return action.reshape(-1, *action.shape[2:])

    def _moves_near(self, before: State, target: Integers, rng: np.random.Generator) -> Integers:
        """Directions to try from the states of width · moves · choices environments."""
        cell = before.cell
        if cell.shape[1] == 1:
            every = np.repeat(np.arange(self._directions), self._choices)
            return np.tile(every, self._width)[:, None]
        strays = rng.random(cell.shape) < 0.5
        strays[:: self._moves * self._choices] = False
        stray = rng.integers(0, self._directions, cell.shape)
        towards = self._simulator.towards(before, np.broadcast_to(target, cell.shape))
        return np.where(strays, stray, towards)

    def _score(self, state: State, weights: Weights, slots_left: int) -> Floats:
        """Ages so far and to be expected, less what the stores are worth: (envs,)."""
        world = self._simulator.world
        lacking = links(world, world.motion.heading(state), state).missing_slots.min(axis=1)
        lasting = weights.lasting_slots + np.clip(lacking - 1, 0, weights.lacking_slots)
        to_come = (state.age * np.minimum(lasting, slots_left)).sum(-1)
        stores = np.log(state.energy_j + near_uplink_j(world)).sum(-1)
        worth = weights.store_slots * min(1.0, slots_left / STORES_LAST_SLOTS)
        score: Floats = (state.age_sum - worth * stores) * world.num_nodes + to_come
        return score
