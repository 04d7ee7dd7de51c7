"""Plans: whole episodes are played in the world before the first slot, the best is kept."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from iout_marl.policies.choice import choose, links, near_uplink_j
from iout_marl.policies.routes import tours
from iout_marl.scenario import Scenario, Tdd, load_scenario
from iout_marl.world import State, World

Integers = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]

#: Episodes played side by side, and moves of a fleet tried from each that is kept.
EPISODES = 384
MOVES = 12
#: How TDD chooses between nodes after each move, see `choose`: all are tried.
HASTES = (1.0, 4.0)
#: An episode is judged by the ages it has had, and by what is to come: each age that it ends
#: with counts for this many slots more,
LASTING_SLOTS = 3.0
#: and for each slot of charging that its node lacks, up to this many, one more.
LACKING_SLOTS = 2.0
#: In FDD, a store e times as large makes up for so many slots of age.
STORE_SLOTS = 3.0


class Plan(NamedTuple):
    """An episode as foreseen, slot by slot."""

    states: State  # before each slot: (slots, …)
    actions: Integers  # (slots, auvs, entries)
    age_sum: float  # at the end, see `State`


class Planner:
    """Plans episodes of a scenario, from any state of one environment.

    First the AUVs go round tours of several reaches. Then, if it searches, the best of them
    is improved on by a beam search: in every slot several moves of the fleet are tried from
    each of the episodes that are kept, of which the most promising are kept in turn. Half of
    the moves of several AUVs go along the tours; a lone AUV tries every direction.

    Args:
        scenario: the scenario.
        searches: whether it searches beyond the tours.
    """

    def __init__(self, scenario: Scenario, *, searches: bool) -> None:
        self._searches = searches
        self._hastes = HASTES if isinstance(scenario.duplex, Tdd) else HASTES[:1]
        # What is of no matter to a plan costs time in every step.
        self._scenario = load_scenario(scenario, {"observation.view_range_m": None})
        self._world = world = World(self._scenario)
        self._directions = world.motion.num_directions
        self._moves = self._directions if world.num_auvs == 1 else MOVES
        self._width = EPISODES // (self._moves * len(self._hastes))
        self._worlds: dict[int, World] = {1: world}

    def plan(self, state: State) -> Plan:
        """The best episode found from a state of one environment on."""
        # Nodes in the order of their cells: that in which they are named must not matter.
        order = state.node_cell[0].argsort(kind="stable")
        back = order.argsort(kind="stable")
        routes = self._tours(state)
        best, followed = self._follow(_with_nodes(state, order), routes)
        plan = followed
        if self._searches:
            found = self._search(_with_nodes(state, order), routes[best])
            plan = min(followed, found, key=lambda plan: plan.age_sum)
        actions = plan.actions.copy()
        actions[..., 1:] = order[actions[..., 1:]]
        return Plan(_with_nodes(plan.states, back), actions, plan.age_sum)

    def _tours(self, state: State) -> Integers:
        """(tours, slots, auvs) codes of cells."""
        grid = self._world.grid
        table = grid.coordinate_table()
        routes = tours(
            table[np.sort(state.node_cell[0])],
            table[state.cell[0]],
            max(self._world.num_slots - int(state.slot[0]), 1),
            grid.shape,
            may_rest=self._world.scenario.auvs.motion == "hover",
        )
        return grid.encode(routes)

    def _follow(self, state: State, routes: Integers) -> tuple[int, Plan]:
        """Which of the tours is the best, and the plan that follows it."""
        count, num_slots, _ = routes.shape
        state = _rows(state, np.zeros(count * len(self._hastes), dtype=np.int64))
        cells = np.tile(routes, (len(self._hastes), 1, 1))
        # The same haste through the whole episode.
        which = np.arange(len(cells)) // count, np.arange(len(cells))
        states, actions = [], []
        for slot in range(num_slots):
            direction = self._towards(state.cell, cells[:, slot])
            action = self._actions(state, direction)[which]
            states.append(state)
            actions.append(action)
            state = self._step(state, action)
        best = int(state.age_sum.argmin())
        path = [best] * num_slots
        return best % count, _traced(states, actions, path, path, state, best)

    def _search(self, state: State, route: Integers) -> Plan:
        """Beam search near a route, (slots, auvs)."""
        rng = np.random.default_rng(0)
        beam = _rows(state, np.zeros(self._width, dtype=np.int64))
        parent = np.repeat(np.arange(self._width), self._moves)
        parents = np.tile(parent, len(self._hastes))
        states, actions, kept_parents = [], [], []
        for cells in route:
            before = _rows(beam, parent)
            direction = self._moves_near(before.cell, cells, rng)
            action = self._actions(before, direction)
            action = action.reshape(-1, *action.shape[2:])
            after = self._step(_rows(beam, parents), action)
            # Episodes that come to the same by other ways are one.
            _, distinct = np.unique(self._prospect(after).round(6), return_index=True)
            kept = np.resize(distinct[: self._width], self._width)
            states.append(beam)
            actions.append(action[kept])
            kept_parents.append(parents[kept])
            beam = _rows(after, kept)
        best = int(beam.age_sum.argmin())
        children = [best]
        for kept in reversed(kept_parents):
            children.append(int(kept[children[-1]]))
        children.reverse()
        return _traced(states, actions, children[:-1], children[1:], beam, best)

    def _moves_near(self, cell: Integers, target: Integers, rng: np.random.Generator) -> Integers:
        """Directions to try from (width · moves, auvs) cells."""
        if cell.shape[1] == 1:
            return np.tile(np.arange(self._directions), self._width)[:, None]
        strays = rng.random(cell.shape) < 0.5
        strays[:: self._moves] = False
        stray = rng.integers(0, self._directions, cell.shape)
        return np.where(strays, stray, self._towards(cell, np.broadcast_to(target, cell.shape)))

    def _towards(self, cell: Integers, target: Integers) -> Integers:
        """The directions, in the grid, that end nearest to the targets; (envs, auvs) each."""
        motion, link = self._world.motion, self._world.link
        offset = link.offset(motion.neighbours(cell), target[..., None])
        distance_m = link.at(link.distance_m, offset)
        return np.where(motion.stays_inside(cell), distance_m, np.inf).argmin(-1)

    def _actions(self, state: State, direction: Integers) -> Integers:
        """Whole actions, (hastes, envs, auvs, entries)."""
        world = self._world
        cell, _, _ = world.motion.move(state.cell, direction)
        nodes = choose(world, state, cell, self._hastes)
        directions = np.broadcast_to(direction[..., None], (*nodes.shape[:-1], 1))
        return np.concatenate([directions, nodes], axis=-1)

    def _step(self, state: State, action: Integers) -> State:
        count = len(action)
        if count not in self._worlds:
            self._worlds[count] = World(self._scenario, count)
        return self._worlds[count].step(state, action)[0]

    def _prospect(self, state: State) -> Floats:
        """Ages so far and to be expected, less what the stores are worth: (envs,)."""
        lacking = links(self._world, state.cell, state).missing_slots.min(axis=1)
        lasting = LASTING_SLOTS + np.clip(lacking - 1, 0, LACKING_SLOTS)
        num_nodes = self._world.num_nodes
        ages: Floats = state.age_sum * num_nodes + (state.age * lasting).sum(-1)
        if isinstance(self._world.scenario.duplex, Tdd):
            return ages
        stores = np.log(state.energy_j + near_uplink_j(self._world)).sum(-1)
        return ages - STORE_SLOTS * num_nodes * stores


def _rows(state: State, index: Integers) -> State:
    return state.map(lambda array: array[index])


def _with_nodes(state: State, order: Integers) -> State:
    """The state with the nodes in another order."""
    names = ("node_cell", "age", "energy_j", "deliveries")
    return state._replace(**{name: getattr(state, name)[:, order] for name in names})


def _traced(
    states: list[State],
    actions: list[Integers],
    before: list[int],
    taken: list[int],
    end: State,
    best: int,
) -> Plan:
    """The plan that leads through those rows of the states, by those rows of the actions."""
    rows = [[array[i] for array in state] for state, i in zip(states, before, strict=True)]
    return Plan(
        State(*(np.array(values) for values in zip(*rows, strict=True))),
        np.array([action[i] for action, i in zip(actions, taken, strict=True)]),
        float(end.age_sum[best]),
    )
