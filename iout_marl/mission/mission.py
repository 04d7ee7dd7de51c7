"""The episode of a policy as a mission."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from iout_marl.errors import InputError
from iout_marl.evaluation import play
from iout_marl.mission.geography import Place
from iout_marl.mission.route import Route
from iout_marl.policies import AnyPolicy, policy_for
from iout_marl.scenario import AnyScenario, Overrides, load_scenario
from iout_marl.world import World


@dataclass(frozen=True)
class Action:
    """What an AUV does with a node in a slot.

    Attributes:
        auv, slot, node: counted from 1.
        kind: "charge", or "hear" for asking the node for its packet.
        start_s, end_s: since the mission began.
        cell: where the AUV is meant to be, the cell that it reaches within the slot.
        energy_j: that the node harvests, or spends on the uplink.
        delivered: whether the packet is expected to arrive; None where none is asked for.
    """

    auv: int
    slot: int
    kind: str
    node: int
    start_s: float
    end_s: float
    cell: tuple[int, int, int]
    energy_j: float
    delivered: bool | None


@dataclass(frozen=True)
class Mission:
    """An episode as a plan for vehicles.

    Attributes:
        scenario, scenario_hash, policy, seed: of the episode.
        place: where the grid lies.
        start: when it begins, in UTC.
        slot_s: length of a slot.
        speed_m_per_s: cruising speed.
        node_cells: cells of the nodes, counted from 1.
        routes: of each AUV.
        actions: of all AUVs, in the order of time.
    """

    scenario: str
    scenario_hash: str
    policy: str
    seed: int
    place: Place
    start: datetime
    slot_s: float
    speed_m_per_s: float
    node_cells: tuple[tuple[int, int, int], ...]
    routes: tuple[Route, ...]
    actions: tuple[Action, ...]

    def at(self, seconds: float) -> str:
        """The UTC time so many seconds after the start, to the millisecond, as ISO 8601 has it."""
        moment = self.start + timedelta(seconds=seconds)
        return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def plan_mission(
    scenario: AnyScenario,
    policy: AnyPolicy,
    seed: int = 0,
    start: datetime | None = None,
    *,
    overrides: Overrides = None,
) -> Mission:
    """Play one episode, the first of those of `evaluate`, and make a plan of it.

    Args:
        scenario, policy, seed, overrides: as for `evaluate`.
        start: when the mission begins; without a zone it is UTC. None for now.

    Raises:
        InputError: as `evaluate` does; or the mission would end after the year 9999.
        TypeError: the policy is none.
    """
    scenario, player = policy_for(load_scenario(scenario, overrides), policy, seed)
    world = World(scenario)
    start = start or datetime.now(UTC).replace(microsecond=0)
    start = start.replace(tzinfo=UTC) if start.tzinfo is None else start.astimezone(UTC)
    try:
        start + timedelta(seconds=(scenario.num_slots + 1) * scenario.slot_s)
    except OverflowError:
        raise InputError(f"{start.date()}: the mission would end after the year 9999") from None
    cells = world.grid.coordinate_table() + 1
    place = Place(scenario.grid)
    path: list[Any] = []
    actions: list[Action] = []
    node_cells: tuple[tuple[int, int, int], ...] = ()
    for state, events in play(world, player, seed):
        path.append(cells[state.cell[0]])
        if events is None:
            node_cells = tuple(map(tuple, cells[state.node_cell[0]].tolist()))
        else:
            actions += _actions(world, len(path) - 1, path[-1], events)
    paths = np.array(path)
    return Mission(
        scenario=scenario.name,
        scenario_hash=scenario.hash,
        policy=str(player.name),
        seed=seed,
        place=place,
        start=start,
        slot_s=scenario.slot_s,
        speed_m_per_s=scenario.auvs.speed_m_per_s,
        node_cells=node_cells,
        routes=tuple(
            Route.from_path(auv + 1, paths[:, auv], place, scenario.slot_s)
            for auv in range(world.num_auvs)
        ),
        actions=tuple(actions),
    )


def _actions(world: World, slot: int, cells: Any, events: Any) -> list[Action]:
    """What the AUVs do in a slot, counted from 1; a part of it for which there is no time is none.

    Charging comes first where both share the slot, and else takes all of it.
    """
    begins_s, ends_s = (slot - 1) * world.link.slot_s, slot * world.link.slot_s
    found = []
    for auv in range(world.num_auvs):
        turn_s = begins_s + float(events.beta[0, auv]) * (ends_s - begins_s)
        splits = world.duplex.splits_slot
        charges_until_s, hears_from_s = (turn_s, turn_s) if splits else (ends_s, begins_s)
        cell = tuple(cells[auv].tolist())
        if charges_until_s > begins_s:
            node, energy_j = int(events.charged[0, auv]), float(events.harvested_j[0, auv])
            charge = ("charge", node + 1, begins_s, charges_until_s)
            found.append(Action(auv + 1, slot, *charge, cell, energy_j, None))
        if hears_from_s < ends_s:
            node, energy_j = int(events.heard[0, auv]), float(events.spent_j[0, auv])
            hear = ("hear", node + 1, hears_from_s, ends_s)
            delivered = bool(events.delivered[0, auv])
            found.append(Action(auv + 1, slot, *hear, cell, energy_j, delivered))
    return found
