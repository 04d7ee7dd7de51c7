"""A round that returns to a dock in time."""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from iout_marl.policies.choice import greedy_action, links
from iout_marl.policies.policy import Actions
from iout_marl.policies.predicting import BasePolicy
from iout_marl.policies.routes import rounds
from iout_marl.scenario import Scenario
from iout_marl.world import State, World

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
#: An AUV leaves its dock with this share of a full battery, or more.
FULL = 0.95
#: Slots of moving that it has to spare where there are others, and the most of a battery for it.
DETOUR_SLOTS, MOST_SPARE = 6, 0.3
#: What decides between ways that are alike.
_BACK = 1 + 1e-6


@dataclass
class _Round:
    """Where the AUVs of a batch of environments are on their rounds."""

    stops: Integers  # (envs, auvs, stops) codes of the cells that each AUV visits in turn
    at: Integers  # (envs, auvs) which of them is next
    is_returning: npt.NDArray[np.bool_]  # (envs, auvs) heading for a dock, or recharging there
    came_from: Integers  # (envs, auvs) codes of the cells that they were in a slot ago


class Return(BasePolicy):
    """Every AUV goes round its share of the nodes, and returns to the nearest dock in time.

    It turns back as soon as one more slot of its round, in which it charges throughout, would
    leave too little for the way to the nearest dock, and goes on with a battery that is `FULL`.
    Nodes are named as by `tour`. Where an AUV may charge nobody (`auvs.idle_choices`), it charges
    nobody on its way back. Docks are shared out among AUVs, those nearest to their starts, where
    there are enough of them; who finds its dock taken waits, and AUVs go round others that are in
    their way. In a current every move counts as one against the strongest that there is, and
    none is chosen that is impossible now; one that takes an AUV away is not foreseen. Without
    docks, or end of energy, it is a round alone.
    """

    name = "return"
    is_deterministic = True

    def __init__(self) -> None:
        self._rounds: WeakKeyDictionary[World, _Round] = WeakKeyDictionary()
        self._home_j: WeakKeyDictionary[World, Floats] = WeakKeyDictionary()

    def act(self, world: World, state: State, rng: np.random.Generator) -> Actions:  # noqa: ARG002
        found = self._round(world, state)
        here, every = state.cell, np.indices(state.cell.shape)
        possible = world.manoeuvre.open(state)
        neighbours, inside = world.motion.neighbours(here), world.motion.stays_inside(here)
        for _ in range(found.stops.shape[-1]):  # stops of one cell are all reached at once
            stop = found.stops[*every, found.at]
            way_m = np.where(inside, _way_m(world, neighbours, stop[..., None]), np.inf)
            # One that lies between the cells that moves over several end in is as good as reached.
            arrived = _way_m(world, here, stop) <= way_m.min(-1)
            found.at = np.where(arrived, (found.at + 1) % found.stops.shape[-1], found.at)
        stop = found.stops[*every, found.at][..., None]
        way_m = np.where(possible, _way_m(world, neighbours, stop), np.inf)
        direction = _around_others(world, state, way_m, found.came_from)
        if world.vehicle.is_limited and world.vehicle.docks:
            home_j = self._energy_home_j(world)
            found.is_returning = _returns(world, state, direction, found.is_returning, home_j)
            left_j = np.where(possible, _by_auv(home_j, neighbours), np.inf)
            left = np.where(found.is_returning[..., None], left_j, way_m)
            direction = _around_others(world, state, left, found.came_from)
        found.came_from = here
        nodes = _named(world, state, direction, found.is_returning)
        return np.concatenate([direction[..., None], nodes], axis=-1)

    def _round(self, world: World, state: State) -> _Round:
        """The rounds of the environments, begun where their episodes are."""
        begins = state.slot == 0
        found = self._rounds.get(world)
        if found is None:
            begins = np.ones_like(begins)
            shape = (world.num_envs, world.num_auvs)
            stops = -(-world.num_nodes // world.num_auvs)
            found = self._rounds[world] = _Round(
                np.zeros((*shape, stops), dtype=np.int64),
                np.zeros(shape, dtype=np.int64),
                np.zeros(shape, dtype=np.bool_),
                np.zeros(shape, dtype=np.int64),
            )
        table = world.grid.coordinate_table()
        for env in np.flatnonzero(begins):
            starts = table[state.cell[env]].astype(np.float64)
            nodes = table[state.node_cell[env]].astype(np.float64)
            for auv, own in enumerate(rounds(nodes, starts)):
                last = np.minimum(np.arange(found.stops.shape[-1]), len(own) - 1)
                found.stops[env, auv] = world.grid.encode(np.rint(own[last]).astype(np.int64))
                found.at[env, auv] = np.abs(own[last] - starts[auv]).sum(-1).argmin()
            found.is_returning[env] = False
        return found

    def _energy_home_j(self, world: World) -> Floats:
        """What the way to its nearest dock takes each AUV, axis by axis: (auvs, codes of cells)."""
        if world not in self._home_j:
            vehicle, grid, slot_s = world.vehicle, world.grid, world.link.slot_s
            slots, cells = world.motion.pace.along_axes(world.motion.steps)
            speed = np.array(grid.edges_m) * cells / (slots * slot_s)
            power_w = np.asarray(vehicle.propulsion_power_w(speed + _against_m_per_s(world)))
            move_j = (power_w + vehicle.hotel_w + _charging_w(world)) * slots * slot_s
            docks = np.array(vehicle.docks) - 1
            moves = -(-np.abs(grid.coordinate_table()[:, None, :] - docks) // cells)
            by_dock_j = (moves * move_j).sum(-1)
            own = [by_dock_j[:, which].min(-1) for which in _shared_out(world.scenario)]
            self._home_j[world] = np.stack(own)
        return self._home_j[world]


def _shared_out(scenario: Scenario) -> list[Integers]:
    """Which docks are each AUV's: all of them where they are fewer than the AUVs.

    Else the AUV that starts nearest to one has it, as long as others have one left each.
    """
    docks, starts = np.array(scenario.vehicle.part.docks) - 1, scenario.starts()
    count = len(starts)
    if len(docks) < count:
        return [np.arange(len(docks))] * count
    apart = np.abs((starts[:, None, :] - docks) * np.array(scenario.grid.edges_m)).sum(-1)
    owner = np.full(len(docks), -1)
    for place in np.argsort(apart, axis=None, kind="stable"):
        auv, dock = np.unravel_index(place, apart.shape)
        free, without = (owner < 0).sum(), count - len(set(owner.tolist()) - {-1})
        if owner[dock] < 0 and (auv not in owner or free > without):
            owner[dock] = auv
    return [np.flatnonzero(owner == auv) for auv in range(count)]


def _spare_j(world: World) -> float:
    """What each of several AUVs keeps for ways round others, and for waiting until a dock is free.

    That is no more than `MOST_SPARE` of a battery.
    """
    if world.num_auvs == 1:
        return 0.0
    vehicle, slot_s = world.vehicle, world.link.slot_s
    fastest = max(world.scenario.grid.edges_m) / slot_s + _against_m_per_s(world)
    power_w = float(np.max(vehicle.propulsion_power_w(np.array([fastest])))) + vehicle.hotel_w
    others = max(world.num_auvs / len(vehicle.docks) - 1, 0.0)
    refill_s = vehicle.capacity_j / (vehicle.dock_power_w - vehicle.hotel_w)
    spare_j = DETOUR_SLOTS * slot_s * power_w + others * refill_s * vehicle.hotel_w
    return min(spare_j, MOST_SPARE * vehicle.capacity_j)


def _by_auv(table: Floats, cells: Integers) -> Floats:
    """Entries of an (auvs, codes) table for (envs, auvs, …) cells."""
    auvs = np.arange(len(table)).reshape(-1, *(1,) * (cells.ndim - 2))
    found: Floats = table[auvs, cells]
    return found


def _around_others(world: World, state: State, cost: Floats, came_from: Integers) -> Integers:
    """The cheapest direction of each AUV, (envs, auvs), that leads around others.

    One after the other they leave free where others are, and where those before them go. Who finds
    another AUV in its way goes round it, but waits for what costs nothing more, such as a dock; for
    one that only passes it waits.

    Args:
        world: the world.
        state: the state.
        cost: (envs, auvs, directions) what is left from where a direction leads, infinite where it
            must not be chosen.
        came_from: (envs, auvs) codes of the cells before: of directions alike nobody turns back.
    """
    if world.num_auvs == 1:
        only: Integers = cost.argmin(-1)
        return only
    motion, cells = world.motion, state.cell
    leads_to = motion.neighbours(cells)
    cost = np.where(leads_to == came_from[..., None], cost * _BACK, cost)
    chosen: list[Integers] = []
    targets: list[Integers] = []
    stay: list[npt.NDArray[np.bool_]] = []
    for auv in range(world.num_auvs):
        own, own_cost = leads_to[:, auv], cost[:, auv]
        rests = own == cells[:, auv, None]
        # Those before it leave their cells, unless they stay, and nobody swaps cells.
        there = np.concatenate([*targets, cells[:, auv + 1 :]], axis=1)
        stays = np.concatenate([*stay, np.ones_like(cells[:, auv + 1 :], dtype=np.bool_)], axis=1)
        near = np.asarray(motion.are_near(own[..., None], there[:, None, :]))
        swaps = (own[..., None] == cells[:, None, :auv]) & (
            there[:, None, :auv] == cells[:, auv, None, None]
        )
        is_taken = near.any(-1) | swaps.any(-1)
        best = own_cost.argmin(-1)[:, None]
        # For one that only passes it waits, and for what costs nothing more.
        waits = np.take_along_axis(own_cost, best, -1) == 0
        waits |= ~np.take_along_axis((near & stays[:, None, :]).any(-1) | swaps.any(-1), best, -1)
        own_cost = np.where(np.where(rests, ~waits, is_taken), np.inf, own_cost)
        open_one = np.where(np.isfinite(own_cost.min(-1)), own_cost.argmin(-1), best[:, 0])
        best = np.where(np.take_along_axis(is_taken, best, -1)[:, 0], open_one, best[:, 0])
        chosen.append(best)
        targets.append(np.take_along_axis(own, best[:, None], -1))
        stay.append(np.take_along_axis(rests, best[:, None], -1))
    return np.stack(chosen, axis=1)


def _way_m(world: World, first: Integers, second: Integers) -> Floats:
    """The way between cells, which broadcast."""
    way_m: Floats = world.link.at(world.link.way_m, world.link.offset(first, second))
    return way_m


def _against_m_per_s(world: World) -> float:
    """By how much a current may at most make moves faster through the water than over ground."""
    return 0.0 if world.current is None else world.current.strongest_m_per_s


def _charging_w(world: World) -> float:
    """What charging takes on the way to a dock: nothing where nobody need be charged."""
    scenario = world.scenario
    return 0.0 if scenario.auvs.idle_choices else scenario.charging.power_w


def _returns(
    world: World,
    state: State,
    direction: Integers,
    is_returning: npt.NDArray[np.bool_],
    home_j: Floats,
) -> npt.NDArray[np.bool_]:
    """Which AUVs head for a dock, or recharge there."""
    vehicle, slot_s = world.vehicle, world.link.slot_s
    target = world.motion.targets(state, direction)
    if world.current is None:
        slot_j = np.asarray(vehicle.propulsion_j(state.cell, target))
    else:
        slot_j = vehicle.dearest_j(state.cell, target)
    slot_j = slot_j + (vehicle.hotel_w + world.scenario.charging.power_w) * slot_s
    left_j = state.battery_j - vehicle.slots(state.cell, target) * slot_j
    goes_on = is_returning & (state.battery_j < FULL * vehicle.capacity_j)
    needed_j = _by_auv(home_j, target) + _spare_j(world)
    too_far: npt.NDArray[np.bool_] = left_j < needed_j
    return goes_on | too_far


def _named(
    world: World, state: State, direction: Integers, is_returning: npt.NDArray[np.bool_]
) -> Integers:
    """The nodes that AUVs name after their moves, (envs, auvs, 1 or 2)."""
    # What a battery cannot pay for is not foreseen.
    moves = world.motion if world.current is None else world.manoeuvre
    cell = moves.move(state, direction).cell
    nodes = greedy_action(world, state, cell, (1.0,))[0]
    if world.scenario.auvs.idle_choices:
        spares = is_returning
        if world.duplex.num_choices == 1:
            # What would be heard without being charged is heard anyway.
            offset = np.take_along_axis(links(world, cell, state).offset, nodes, -1)[..., 0]
            stored_j = np.take_along_axis(state.energy_j, nodes[..., 0], -1)
            split = world.duplex.split(offset, offset, stored_j)
            spares = spares & (np.asarray(split.charging_s) > 0)
        nodes[..., 0] = np.where(spares, world.num_nodes, nodes[..., 0])
    return nodes
