"""What an AUV sees, and what a critic of all of them may see."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from iout_marl.core.pace import Pace
from iout_marl.core.ranges import Ranges
from iout_marl.core.state import State
from iout_marl.core.table import TableLayout
from iout_marl.parts import Context, Entry, at_work
from iout_marl.physics.arrays import Array, joined
from iout_marl.scenario import Scenario

__all__ = ["Observer", "Ranges"]

#: The order of rows in a table, see `TableLayout`.
_ROWS = ("context", "auvs", "nodes", "moves")


class Observer:
    """Builds observations from the entries that a scenario names, in this order.

    An AUV's position, the ages and the stored energies of the nodes; where the scenario says so,
    the nodes' positions, the share of the episode that is over, where the other AUVs are, how
    many slots ago it saw each node, and which AUV it is; then entries from outside.

    Args:
        scenario: the scenario.
        context: what entries work with.

    Attributes:
        entries: the entries.
        agent_ranges, state_ranges: ranges of an observation, and of what `observe_globally` gives.
        node_entries: entries of an observation that tell of each node: ages, energies.
        layout: of a node table; None of other observations.
    """

    def __init__(self, scenario: Scenario, context: Context) -> None:
        self._xp = context.backend.xp
        self._num_auvs = scenario.num_auvs
        self._represent = represent = context.representation
        self._is_credited_apart: bool = scenario.reward.part.is_credited_apart
        self.entries: tuple[Entry, ...] = tuple(
            at_work(settings, context) for settings in scenario.seen
        )
        self.layout: TableLayout | None = None
        #: Whether the state of the network holds nothing that an observation does not.
        self._sees_all = represent.is_table and scenario.observation.view_range_m is None
        if represent.is_table:
            self.entries = tuple(sorted(self.entries, key=lambda entry: _ROWS.index(entry.rows)))
            self.layout = _layout(scenario, self.entries)
        self._is_from_outside = any(entry.settings.entry.is_outside for entry in self.entries)
        self.agent_ranges = Ranges.joined([_ranges(entry) for entry in self.entries])
        ends = list(itertools.accumulate(entry.size for entry in self.entries))
        self.node_entries = tuple(
            slice(end - entry.size, end)
            for entry, end in zip(self.entries, ends, strict=True)
            if entry.feeds_node_network
        )
        pace = Pace.from_scenario(scenario)
        self._has_transit, self._most_waits = pace.takes_slots, int(pace.slots.max()) - 1
        self._vehicle = scenario.vehicle.part
        batteries = scenario.num_auvs if self._vehicle.is_limited else 0
        cell = represent.position_ranges()
        self.state_ranges = Ranges.joined(
            [
                *[cell] * scenario.num_auvs,
                represent.age_ranges(),
                represent.energy_ranges(),
                represent.count_ranges(),
                *[cell] * scenario.num_nodes,
                Ranges.uniform(1 + batteries, 0, 1, 1),
                *[represent.wait_ranges(scenario.num_auvs, self._most_waits)] * self._has_transit,
            ]
        )

    def observe(self, state: State) -> Array:
        """Observations of every AUV: (envs, auvs, entries)."""
        xp = self._xp
        parts = [entry(state) for entry in self.entries]
        if self._is_from_outside:
            parts = [self._of_all_auvs(part) for part in parts]
        # Each entry of all environments in a row, as they come.
        return joined(xp, parts)

    def _of_all_auvs(self, values: Array) -> Array:
        if values.shape[1] == self._num_auvs:
            return values
        return self._xp.broadcast_to(values, (values.shape[0], self._num_auvs, values.shape[2]))

    def observe_globally(self, state: State) -> Array:
        """What a central critic sees, written as observations are: (envs, entries).

        Positions of all AUVs, ages, energies and deliveries of all nodes, positions of
        the nodes, share of the episode that is over; of AUVs with batteries, what share of them
        is left; where moves may take longer than a slot, how many slots those of the AUVs still
        take.
        """
        represent, num_envs = self._represent, state.cell.shape[0]
        auvs, nodes = (
            self._xp.reshape(represent.positions(cell), (num_envs, -1))
            for cell in (state.cell, state.node_cell)
        )
        parts = [
            auvs,
            represent.ages(state.age),
            represent.energies(state.energy_j),
            represent.counts(state.deliveries),
            nodes,
            represent.time(state.slot),
        ]
        if self._vehicle.is_limited:
            parts.append(state.battery_j / self._vehicle.capacity_j)
        if self._has_transit:
            slots = self._xp.astype(state.transit_slots, state.age.dtype)
            parts.append(represent.waits(slots, self._most_waits))
        return self._xp.concat(parts, axis=-1)

    def observe_for_critic(self, state: State, *, central: bool) -> Array | None:
        """What an AUV's critic sees beside its observation: (envs, auvs, entries).

        The state of the network, where it is central; with difference rewards also the ages
        and deliveries by packets to others alone, of which the reward is made. None for nothing.
        """
        represent, parts = self._represent, []
        if central and not self._sees_all:
            seen = self.observe_globally(state)[:, None, :]
            parts.append(self._of_all_auvs(seen))
        if self._is_credited_apart:
            parts.append(represent.ages(state.others_age))
            parts.append(represent.counts(state.others_deliveries))
        return self._xp.concat(parts, axis=-1) if parts else None

    def critic_ranges(self, *, central: bool) -> Ranges | None:
        """Ranges of `observe_for_critic`."""
        represent = self._represent
        parts = [self.state_ranges] if central and not self._sees_all else []
        if self._is_credited_apart:
            parts += [represent.age_ranges(), represent.count_ranges()]
        return Ranges.joined(parts) if parts else None


def _layout(scenario: Scenario, entries: Sequence[Entry]) -> TableLayout:
    columns = {rows: [entry for entry in entries if entry.rows == rows] for rows in _ROWS}
    auvs, nodes, moves = (sum(entry.columns for entry in columns[rows]) for rows in _ROWS[1:])
    return TableLayout(
        sum(entry.size for entry in columns["context"]),
        scenario.num_auvs - 1,
        auvs,
        scenario.num_nodes,
        nodes,
        len(scenario.auvs.motion.part.steps),
        moves,
    )


def _ranges(entry: Entry) -> Ranges:
    """The ranges of an entry; those of one from outside after a look at them."""
    registered = entry.settings.entry
    with registered.blamed():
        return entry.checked_ranges() if registered.is_outside else entry.ranges()
