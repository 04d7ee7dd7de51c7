"""The episode of a policy as a mission."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import numpy as np
import numpy.typing as npt

from iout_marl.core.geography import Place
from iout_marl.errors import InputError
from iout_marl.mission.legs import SECOND_DIGITS
from iout_marl.mission.route import Route
from iout_marl.policies import AnyPolicy, policy_for
from iout_marl.replay.recorder import record_player
from iout_marl.replay.recording import Recording
from iout_marl.scenario import AnyScenario, Overrides, Scenario, load_scenario
from iout_marl.whole import short


@dataclass(frozen=True)
class Action:
    """What an AUV does with a node in a slot.

    Attributes:
        auv, slot, node: counted from 1.
        kind: "charge", or "hear" for asking the node for its packet.
        start_s, end_s: since the mission began.
        position: where the AUV is meant to be at the end of the slot, in cells: under way between
            the two. The energy is that in the cell which it then still leaves.
        energy_j: that the node harvests, or spends on the uplink.
        delivered: whether the packet is expected to arrive; None where none is asked for.
    """

    auv: int
    slot: int
    kind: str
    node: int
    start_s: float
    end_s: float
    position: tuple[float, float, float]
    energy_j: float
    delivered: bool | None


@dataclass(frozen=True, eq=False)
class Mission:
    """An episode as a plan for vehicles.

    Attributes:
        scenario, scenario_hash, policy, seed: of the episode; its seed is None if not known.
        place: where the grid lies.
        start: when it begins, in UTC.
        slot_s: length of a slot.
        speed_m_per_s: cruising speed.
        node_cells: (nodes, 3) cells of the nodes, counted from 1.
        routes: of each AUV.
        actions: of all AUVs, in the order of time.
    """

    scenario: str
    scenario_hash: str
    policy: str
    seed: int | None
    place: Place
    start: datetime
    slot_s: float
    speed_m_per_s: float
    node_cells: npt.NDArray[np.int64]
    routes: tuple[Route, ...]
    actions: tuple[Action, ...]

    def at(self, seconds: float) -> str:
        """The UTC time so many seconds after the start, to the millisecond, as ISO 8601 has it."""
        # What is written is cut off below the millisecond: half of one rounds instead.
        rounded = timedelta(seconds=round(seconds, SECOND_DIGITS), microseconds=500)
        moment = self.start + rounded
        return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")

    @classmethod
    def from_recording(
        cls, recording: Recording, scenario: Scenario, start: datetime | None = None
    ) -> Mission:
        """The mission that does what was done in an episode.

        Args:
            recording: the episode.
            scenario: that of the episode, which says where its grid lies.
            start: when the mission begins; without a zone it is UTC. None for now.

        Raises:
            InputError: the scenario has another grid, or slots of another length, than that of
                the episode; or the mission would begin before the year 1, or end after the year
                9999.
        """
        _check_same_grid(recording, scenario)
        place = Place(scenario.grid)
        # What is begun and given up is not in a plan.
        positions = recording.positions(only_arriving=True)
        routes = tuple(
            Route.from_path(auv + 1, positions[:, auv], place, recording.slot_s)
            for auv in range(recording.num_auvs)
        )
        return cls(
            scenario=recording.scenario,
            scenario_hash=recording.scenario_hash,
            policy=recording.policy,
            seed=recording.seed,
            place=place,
            start=_checked_start(start, recording.slots * recording.slot_s),
            slot_s=recording.slot_s,
            speed_m_per_s=scenario.auvs.speed_m_per_s,
            node_cells=recording.nodes,
            routes=routes,
            actions=tuple(
                action
                for slot in range(recording.slots)
                for auv in range(recording.num_auvs)
                for action in _actions(recording, slot, auv, positions[slot + 1, auv])
            ),
        )


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
        start: as for `Mission.from_recording`.

    Raises:
        InputError: as `evaluate` and `Mission.from_recording` do.
        TypeError: the policy is none.
    """
    loaded, player = policy_for(load_scenario(scenario, overrides), policy, seed)
    return Mission.from_recording(record_player(loaded, player, seed), loaded, start)


def _check_same_grid(recording: Recording, scenario: Scenario) -> None:
    """Refuse a scenario in which the cells or slots of a recording mean something else.

    Its AUVs may be more or fewer, and its training another.
    """
    for key, recorded, own in (
        ("grid.cells", recording.grid, scenario.grid.cells),
        ("grid.spacing_m", recording.spacing_m, scenario.grid.spacing_m),
        ("slot_s", recording.slot_s, scenario.slot_s),
    ):
        # One number is meant for each of the three axes.
        if not np.array_equal(np.broadcast_to(recorded, 3), np.broadcast_to(own, 3)):
            raise InputError(
                f"scenario: {scenario.name} has {key} {short(own)}, but the recording of "
                f"{recording.scenario} has {short(recorded)}: give the scenario of the recording"
            )


def _checked_start(start: datetime | None, duration_s: float) -> datetime:
    """A start in UTC of a mission that ends while there are dates."""
    if start is None:
        start = datetime.now(UTC).replace(microsecond=0)
    try:
        utc = start.replace(tzinfo=UTC) if start.tzinfo is None else start.astimezone(UTC)
        utc + timedelta(seconds=duration_s + 1)
    except OverflowError:
        raise InputError(
            f"{start.date()}: the mission would not lie within the years 1 to 9999"
        ) from None
    return utc


def _actions(
    recording: Recording, slot: int, auv: int, position: npt.NDArray[np.float64]
) -> Iterator[Action]:
    """What an AUV does in a slot, from 0, at a position.

    A part of it for which there is no time is none, nor is one in which it names nobody.

    Charging comes first where both share the slot, and else both take all of it. Nodes that are
    heard one after the other come in this order, all with the time that there is for hearing.
    """
    begins_s, ends_s = slot * recording.slot_s, (slot + 1) * recording.slot_s
    beta = float(recording.beta[slot, auv])
    turn_s = begins_s + beta * recording.slot_s
    charged = int(recording.charged[slot, auv])
    x, y, z = position.tolist()
    if charged:
        until_s = turn_s if recording.splits_slot else ends_s
        energy_j = float(recording.harvested_j[slot, auv])
        times = (begins_s, until_s)
        yield Action(auv + 1, slot + 1, "charge", charged, *times, (x, y, z), energy_j, None)
    if recording.splits_slot and beta == 1:
        return
    times = (turn_s if recording.splits_slot else begins_s, ends_s)
    for node, reason, energy_j in recording.uplinks(slot, auv):
        yield Action(
            auv + 1, slot + 1, "hear", node, *times, (x, y, z), energy_j, delivered=reason is None
        )
