"""What episodes come to for each node and each AUV."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from iout_marl.world import Events, State, World


@dataclass(frozen=True)
class Column:
    """A figure that every node, or every AUV, has.

    Attributes:
        name: its key in Python and JSON, with the unit.
        heading: in a table.
        digits: behind the point.
    """

    name: str
    heading: str
    digits: int


NODE_COLUMNS = (
    Column("deliveries", "packets", 1),
    Column("mean_aoi_slots", "mean AoI slots", 2),
    Column("mean_aoi_s", "mean AoI s", 1),
    Column("peak_aoi_slots", "peak AoI slots", 1),
    Column("peak_aoi_s", "peak AoI s", 1),
    Column("harvested_j", "harvest J", 1),
    Column("spent_j", "spent J", 1),
    Column("left_j", "left J", 1),
)
#: Of nodes whose stores have limits, after `NODE_COLUMNS`.
STORE_COLUMNS = (
    Column("spilled_j", "spilled J", 1),
    Column("leaked_j", "leaked J", 1),
    Column("idle_j", "idle J", 1),
    Column("harvested_j_per_day", "harvest J/day", 1),
    Column("spent_j_per_day", "spent J/day", 1),
    Column("asleep_slots", "asleep slots", 1),
    Column("survival_days", "survival days", 3),
)
AUV_COLUMNS = (
    Column("distance_m", "distance m", 0),
    Column("moving_slots", "moving slots", 1),
    Column("moving_s", "moving s", 0),
    Column("packets", "packets", 1),
    Column("delivered_j", "delivered J", 1),
)
#: Of AUVs that can run out of energy, after `AUV_COLUMNS`.
VEHICLE_COLUMNS = (
    Column("propulsion_j", "propulsion J", 0),
    Column("hotel_j", "hotel J", 0),
    Column("charging_j", "charging J", 0),
    Column("docked_j", "docked J", 0),
    Column("battery_j", "battery J", 0),
    Column("stranded_slots", "stranded slots", 1),
)


@dataclass(frozen=True)
class Breakdown:
    """Figures of each node and each AUV over whole episodes.

    Attributes:
        slot_s: length of a slot.
        nodes: by the names of `NODE_COLUMNS`, (episodes, nodes): packets delivered; mean over
            slots and highest of the age; energy harvested, spent on uplinks, and left in the end.
            Where stores have limits also by those of `STORE_COLUMNS`: energy that stores had no
            room for, that they have lost, and that nodes have drawn while idle; what would be
            harvested and spent in a day of such episodes; slots asleep; for how many days what is
            left would pay for losses and idling, where there are any.
        auvs: by the names of `AUV_COLUMNS`, (episodes, auvs): the way; slots in which it moved;
            packets that it has received; energy that nodes have harvested from it. Where they
            can run out of energy also by those of `VEHICLE_COLUMNS`: energy for moves, beside
            moves and charging, and for charging; what docks have given, what the battery has
            left; slots stranded.
    """

    slot_s: float
    nodes: dict[str, npt.NDArray[np.float64]]
    auvs: dict[str, npt.NDArray[np.float64]]

    @property
    def node_columns(self) -> tuple[Column, ...]:
        """The columns that its nodes have."""
        return tuple(c for c in (*NODE_COLUMNS, *STORE_COLUMNS) if c.name in self.nodes)

    @property
    def auv_columns(self) -> tuple[Column, ...]:
        """The columns that its AUVs have."""
        return tuple(c for c in (*AUV_COLUMNS, *VEHICLE_COLUMNS) if c.name in self.auvs)


class Tally:
    """Adds up what happens to each node and each AUV, slot by slot.

    Args:
        world: the world, on NumPy.
        state: the first state.
    """

    def __init__(self, world: World, state: State) -> None:
        self._world = world
        self._cell, self._age = state.cell, state.age
        nodes, auvs = state.age.shape, state.cell.shape
        self._age_sum, self._peak_age = np.zeros(nodes), np.zeros(nodes)
        self._harvested_j, self._spent_j = np.zeros(nodes), np.zeros(nodes)
        self._distance_m, self._moves = np.zeros(auvs), np.zeros(auvs)
        self._packets, self._delivered_j = np.zeros(auvs), np.zeros(auvs)

    def add(self, state: State, events: Events) -> None:
        """Take in a slot; `state` is that after it."""
        nodes, link = self._world.nodes, self._world.link
        sampling = self._world.sampling
        self._age_sum += sampling.counted(self._age, state.age)
        np.maximum(self._peak_age, sampling.highest(self._age, state.age), out=self._peak_age)
        charged, heard = nodes.flat_index(events.charged), nodes.flat_index(events.heard)
        self._harvested_j = nodes.scatter_add(self._harvested_j, charged, events.harvested_j)
        self._spent_j = nodes.scatter_add(self._spent_j, heard, events.spent_j)
        self._distance_m += link.at(link.way_m, link.offset(state.cell, self._cell))
        moves = state.cell != self._cell
        if self._world.motion.takes_slots:
            moves |= state.transit_slots > 0
        self._moves += moves
        self._packets += events.delivered
        for i in range(events.polled.shape[2]):
            polled = nodes.flat_index(events.polled[..., i])
            self._spent_j = nodes.scatter_add(self._spent_j, polled, events.polled_j[..., i])
            self._packets += events.polled_delivered[..., i]
        self._delivered_j += events.harvested_j
        self._cell, self._age = state.cell, state.age

    def result(self, state: State) -> Breakdown:
        """The figures of whole episodes; `state` is the last."""
        slot_s = self._world.link.slot_s
        storage, left_j = self._world.storage, np.array(state.energy_j)
        vehicles = VEHICLE_COLUMNS if self._world.vehicle.is_limited else ()
        # Of moves that are not over, only batteries tell the way.
        distance_m = np.array(state.distance_m) if vehicles else self._distance_m
        mean_age = self._age_sum / self._world.num_slots
        return Breakdown(
            slot_s=slot_s,
            nodes={
                "deliveries": np.array(state.deliveries),
                "mean_aoi_slots": mean_age,
                "mean_aoi_s": mean_age * slot_s,
                "peak_aoi_slots": self._peak_age,
                "peak_aoi_s": self._peak_age * slot_s,
                "harvested_j": self._harvested_j,
                "spent_j": self._spent_j,
                "left_j": left_j,
                **(self._of_stores(state) if storage.is_limited else {}),
                **({"survival_days": storage.survival_days(left_j)} if storage.drains else {}),
            },
            auvs={
                "distance_m": distance_m,
                "moving_slots": self._moves,
                "moving_s": self._moves * slot_s,
                "packets": self._packets,
                "delivered_j": self._delivered_j,
                **{column.name: np.array(getattr(state, column.name)) for column in vehicles},
            },
        )

    def _of_stores(self, state: State) -> dict[str, npt.NDArray[np.float64]]:
        """What `STORE_COLUMNS` name, but for survival."""
        days = self._world.num_slots * self._world.link.slot_s / 86_400
        return {
            "spilled_j": np.array(state.spilled_j),
            "leaked_j": np.array(state.leaked_j),
            "idle_j": np.array(state.idle_j),
            "harvested_j_per_day": self._harvested_j / days,
            "spent_j_per_day": self._spent_j / days,
            "asleep_slots": np.array(state.asleep_slots),
        }
