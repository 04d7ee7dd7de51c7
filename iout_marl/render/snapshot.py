"""What a picture of one environment shows, in plain NumPy."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from iout_marl.world import Events, State, World

Integers = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: Limits of what a picture can show: ratios of such figures are numbers, too.
LARGEST = 1e60


# eq=False: a comparison of arrays would raise, so snapshots compare by identity.
@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """One environment between two slots, and what happened in the slot before.

    The arrays are copies: a snapshot stays as it is while the world continues. Cells are
    counted from 1, AUVs and nodes from 0. What belongs to a slot is None before the first.
    """

    title: str  # name of the scenario
    grid_shape: tuple[int, int, int]  # cells along x, y and z
    slot: int  # slots that are over
    num_slots: int  # slots of an episode
    auv_positions: Integers  # (auvs, 3) cells
    node_positions: Integers  # (nodes, 3) cells
    ages: Floats  # (nodes,) slots: Age of Information A_k
    maximum_age: float  # slots: A_max
    energies_j: Floats  # (nodes,) J: energy stored
    reference_energy_j: float  # J: energy of an uplink over half the grid
    mean_age: float  # slots: mean age over nodes
    jain: float  # Jain's index of the deliveries so far
    total_harvested_j: float  # J: energy harvested by all nodes so far
    duplex: str  # what the duplex part is called
    splits_slot: bool  # whether charging and uplink share the slot
    charged: Integers | None  # (auvs,) node charged in the last slot
    heard: Integers | None  # (auvs,) node asked for its packet in the last slot
    delivered: Flags | None  # (auvs,) whether the packet arrived
    beta: Floats | None  # (auvs,) TDD's share of the last slot for charging; 0 in FDD
    edges_m: tuple[float, float, float] = (1.0, 1.0, 1.0)  # m: edges of a cell along x, y and z
    capacity_j: float | None = None  # J: the most that a node stores; None for no limit
    battery: Floats | None = None  # (auvs,) share of it that is left; None without end of energy
    headings: Integers | None = None  # (auvs, 3) cells that AUVs under way go to, own of others
    transit_slots: Integers | None = None  # (auvs,) slots until moves end; 0 for nobody under way
    progress: Floats | None = None  # (auvs,) share of it that is over, else 0
    docks: Integers | None = None  # (docks, 3) cells in which AUVs are recharged
    stranded: Flags | None = None  # (auvs,) whether the battery was empty in the last slot
    asleep: Flags | None = None  # (nodes,) which slept through it; None where none can
    polled: Integers | None = None  # (auvs, rounds) nodes polled beside, in their order
    polled_delivered: Flags | None = None  # (auvs, rounds) whether their packets arrived
    # (auvs, 2) m/s along x and y: the current that AUVs are in; None in still water
    currents: Floats | None = None

    @classmethod
    def from_world(
        cls, world: World, state: State, events: Events | None, env: int = 0
    ) -> Snapshot:
        """The snapshot of one environment of a batch.

        Args:
            world: the world, on NumPy.
            state: where it is.
            events: what happened in the slot before, or None before the first.
            env: index of the environment.
        """
        coordinates = world.grid.coordinate_table() + 1
        return cls(
            title=world.scenario.name,
            grid_shape=world.grid.shape,
            edges_m=world.grid.edges_m,
            capacity_j=world.storage.capacity_j,
            slot=int(state.slot[env]),
            num_slots=world.num_slots,
            auv_positions=coordinates[state.cell[env]],
            node_positions=coordinates[state.node_cell[env]],
            ages=np.array(state.age[env], dtype=np.float64),
            maximum_age=float(world.scenario.age.maximum),
            energies_j=np.array(state.energy_j[env], dtype=np.float64),
            reference_energy_j=float(world.representation.reference_energy_j),
            mean_age=float(state.mean_age[env]),
            jain=float(state.jain[env]),
            total_harvested_j=float(state.harvested_j[env]),
            duplex=world.duplex.label,
            splits_slot=world.duplex.splits_slot,
            charged=None if events is None else np.array(events.charged[env], dtype=np.int64),
            heard=None if events is None else np.array(events.heard[env], dtype=np.int64),
            delivered=None if events is None else np.array(events.delivered[env], dtype=np.bool_),
            beta=None if events is None else np.array(events.beta[env], dtype=np.float64),
            battery=battery_shares(world, state, env),
            **_transit(world, state, env, coordinates),
            docks=docks_of(world),
            stranded=_stranded(world, events, env),
            asleep=None if events is None else sleeping(world, events, env),
            polled=None if events is None else np.array(events.polled[env], dtype=np.int64),
            polled_delivered=None
            if events is None
            else np.array(events.polled_delivered[env], dtype=np.bool_),
            currents=currents_at(world, state, env),
        )

    def drawable(self) -> Snapshot:
        """The same with figures that a picture can show: from 0 to `LARGEST`, and none that is
        not a number."""
        return replace(
            self,
            ages=_drawable(self.ages),
            maximum_age=max(float(_drawable(self.maximum_age)), 1.0),
            energies_j=_drawable(self.energies_j),
            reference_energy_j=float(_drawable(self.reference_energy_j)),
            mean_age=float(_drawable(self.mean_age)),
            jain=float(_drawable(self.jain)),
            total_harvested_j=float(_drawable(self.total_harvested_j)),
        )

    @property
    def num_auvs(self) -> int:
        return len(self.auv_positions)

    @property
    def auv_places(self) -> Floats:
        """(auvs, 3) where AUVs are drawn, in cells: under way between the two."""
        if self.headings is None or self.progress is None:
            return self.auv_positions.astype(np.float64)
        return self.auv_positions + (self.headings - self.auv_positions) * self.progress[:, None]

    @property
    def under_way(self) -> Flags:
        """(auvs,) which are on a move that is not over."""
        if self.transit_slots is None:
            return np.zeros(self.num_auvs, dtype=np.bool_)
        return self.transit_slots > 0

    @property
    def docked(self) -> Flags:
        """(auvs,) which lie in a dock, and are recharged."""
        if self.docks is None:
            return np.zeros(self.num_auvs, dtype=np.bool_)
        in_dock = (self.auv_positions[:, None] == self.docks[None]).all(axis=-1).any(axis=-1)
        return in_dock & ~self.under_way

    def condition(self, auv: int) -> str:
        """What keeps an AUV from its work, in a word or two; empty for nothing."""
        if self.stranded is not None and self.stranded[auv]:
            return "stranded"
        return "in dock" if self.docked[auv] else ""

    @property
    def num_nodes(self) -> int:
        return len(self.node_positions)

    @property
    def energy_yardstick_j(self) -> float:
        """What a full gauge of energy stands for, in J.

        The capacity of a store, where there is one, else the reference wherever it is a number.
        """
        if self.capacity_j is not None:
            return self.capacity_j
        if math.isfinite(self.reference_energy_j) and self.reference_energy_j > 1 / LARGEST:
            return self.reference_energy_j
        return max(float(self.energies_j.max()), 1.0)

    @property
    def yardstick_text(self) -> str:
        """The same in words."""
        is_limited = self.capacity_j is not None
        return "the capacity of a store" if is_limited else "an uplink over half the grid"

    def charging(self) -> list[tuple[int, int]]:
        """Who charged whom in the last slot: pairs of an AUV and a node."""
        if self.charged is None or self.beta is None:
            return []
        # In TDD β = 0 leaves no time for charging; in FDD β is 0 throughout.
        return [
            (auv, int(node))
            for auv, node in enumerate(self.charged)
            if node < self.num_nodes and (not self.splits_slot or self.beta[auv] > 0)
        ]

    def hearing(self) -> list[tuple[int, int, bool]]:
        """Who asked whom in the last slot: AUV, node, and whether the packet arrived.

        Of each AUV the node that it has chosen comes first, then those that it polled.
        """
        if self.heard is None or self.delivered is None:
            return []
        nodes, arrived = self.heard[:, None], self.delivered[:, None]
        if self.polled is not None and self.polled_delivered is not None:
            nodes = np.concatenate([nodes, self.polled], axis=1)
            arrived = np.concatenate([arrived, self.polled_delivered], axis=1)
        return [
            (auv, int(nodes[auv, i]), bool(arrived[auv, i]))
            for auv, i in np.argwhere(nodes < self.num_nodes).tolist()
        ]


def battery_shares(world: World, state: State, env: int) -> Floats | None:
    """What AUVs of an environment have left of their batteries, (auvs,); None where none has one.

    Args:
        world: the world, on NumPy.
        state: where it is.
        env: index of the environment.
    """
    if not world.vehicle.is_limited:
        return None
    shares = np.array(state.battery_j[env], dtype=np.float64) / world.vehicle.capacity_j
    return np.clip(shares, 0.0, 1.0)


def currents_at(world: World, state: State, env: int) -> Floats | None:
    """The current that AUVs of an environment are in, (auvs, 2) m/s along x and y; None for none.

    Args:
        world: the world, on NumPy.
        state: where it is: the current is that of the slot that begins.
        env: index of the environment.
    """
    if world.current is None:
        return None
    x, y = world.current.at(state)
    return np.stack([x[env], y[env]], axis=-1).astype(np.float64)


def docks_of(world: World) -> Integers | None:
    """(docks, 3) cells, counted from 1, in which AUVs are recharged; None where there are none."""
    docks = world.vehicle.docks if world.vehicle.is_limited else ()
    return np.array(docks, dtype=np.int64).reshape(-1, 3) if docks else None


def sleeping(world: World, events: Events, env: int) -> Flags | None:
    """Which nodes of an environment slept in a slot, (nodes,); None where stores have no limits."""
    if not world.storage.is_limited:
        return None
    return np.array(world.storage.sleeps(events.available_j[env]), dtype=np.bool_)


def _stranded(world: World, events: Events | None, env: int) -> Flags | None:
    if events is None or not world.vehicle.is_limited:
        return None
    return np.array(events.stranded[env], dtype=np.bool_)


def _transit(world: World, state: State, env: int, coordinates: Integers) -> dict[str, Any]:
    """Where AUVs under way go to, and how far they are."""
    if not world.motion.takes_slots:
        return {}
    return {
        "headings": coordinates[world.motion.heading(state)[env]],
        "transit_slots": np.array(state.transit_slots[env], dtype=np.int64),
        "progress": np.array(world.motion.progress(state)[env], dtype=np.float64),
    }


def _drawable(values: npt.ArrayLike) -> Floats:
    return np.clip(np.nan_to_num(np.asarray(values, dtype=np.float64)), 0.0, LARGEST)
