"""Vehicle: what energy AUVs have, and what they spend it on.

Within a slot an AUV pays, in this order, for its hotel load, for its move and for charging. What it
cannot pay for in full it leaves. If it cannot pay for its hotel load, it is stranded: all that it
has left goes there, and it does nothing else. A move over several slots is paid for slot by slot,
and given up where one cannot be paid for. At the end of the slot an AUV is recharged that lies in a
dock and is not under way. In a current holding a cell takes energy, too, but for an AUV that lies
in a dock, where it is moored: see `parts.current`. So it never has less than nothing, and what it
draws and is given adds up to what it has.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated, TypeAlias

import numpy as np
import numpy.typing as npt

from iout_marl.core.current import CurrentField
from iout_marl.core.pace import Pace
from iout_marl.core.state import VEHICLE_FIELDS, State
from iout_marl.parts.base import Context, Part
from iout_marl.physics.arrays import Array, cast, lookup
from iout_marl.registry import Registry
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import LARGEST, SMALLEST, Plausible, Positive, invalid
from iout_marl.whole import is_number, short

#: Speed through the water.
MaxSpeed: TypeAlias = Annotated[Positive, Plausible(0.001, 30, "m/s")] | None
#: Intervals in which powers by speed are tabulated, from rest to the fastest that there is; between
#: them they are interpolated linearly, which is off by less than 1e-6 of the power of a cruise.
SPEED_INTERVALS = 2**14
#: What a speed may exceed the highest one by: a rounding.
_SPEED_ROUNDING = 1 + 1e-6
#: Cells, counted from 1.
Cells: TypeAlias = tuple[tuple[int, int, int], ...]


class Vehicle(Part):
    """The energy of the AUVs, each of the same kind.

    Attributes:
        is_limited: whether an AUV can run out of energy. Of one that cannot a world counts nothing.
        capacity_j: the most that an AUV has, in J.
        initial_j: what every AUV begins an episode with, in J.
        hotel_w: power that it draws all the time, in W.
        docks: cells in which it is recharged, counted from 1.
        dock_power_w: power of that, in W.
        max_speed_m_per_s: the highest speed through the water, in m/s; None for no limit. It only
            matters in a current.
    """

    is_limited: bool = True
    capacity_j: float = LARGEST
    initial_j: float = LARGEST
    hotel_w: float = 0.0
    docks: Cells = ()
    dock_power_w: float = 0.0
    max_speed_m_per_s: float | None = None

    def check(self, scenario: Scenario) -> None:
        limit, cruise = self.max_speed_m_per_s, scenario.auvs.speed_m_per_s
        if limit is not None and limit < cruise:
            raise invalid(
                ("vehicle", "max_speed_m_per_s"),
                f"must not be below the speed over ground, auvs.speed_m_per_s, {cruise:g} m/s",
                beside=("auvs", "speed_m_per_s"),
            )

    def check_stated(self, scenario: Scenario) -> None:
        if not isinstance(self.is_limited, bool):
            raise self.fault(f"is_limited must be True or False, not {short(self.is_limited)}")
        if not is_number(self.capacity_j, SMALLEST, LARGEST):
            raise self.fault(f"capacity_j must be above 0 J, not {short(self.capacity_j)}")
        if not is_number(self.initial_j, 0, self.capacity_j):
            raise self.fault(
                f"initial_j must be from 0 to capacity_j in J, not {short(self.initial_j)}"
            )
        if not (
            self.max_speed_m_per_s is None or is_number(self.max_speed_m_per_s, SMALLEST, LARGEST)
        ):
            raise self.fault(
                "max_speed_m_per_s must be above 0 m/s or None, not "
                f"{short(self.max_speed_m_per_s)}"
            )
        for name in ("hotel_w", "dock_power_w"):
            if not is_number(getattr(self, name), 0, LARGEST):
                raise self.fault(f"{name} must be 0 or more W, not {short(getattr(self, name))}")
        try:
            docks = np.array(self.docks, dtype=np.int64).reshape(-1, 3)
        except (TypeError, ValueError):
            docks = np.zeros((1, 3), dtype=np.int64)
        if not ((docks >= 1) & (docks <= np.array(scenario.grid.cells))).all():
            raise self.fault(f"docks must be cells of the grid, not {short(self.docks)}")
        speeds = np.array([0.0, 1.0, 2.0])
        power_w = np.asarray(self.propulsion_power_w(speeds))
        if (
            power_w.shape != (3,)
            or power_w.dtype.kind != "f"
            or not (np.isfinite(power_w) & (power_w >= 0)).all()
        ):
            raise self.fault(
                "propulsion_power_w must give a power from 0 in W for each of 3 speeds, not "
                f"{short(power_w.tolist())}"
            )
        if power_w[0] != 0:
            raise self.fault(
                f"propulsion_power_w must be 0 W at rest, not {power_w[0]:g}: that is hotel_w"
            )

    def what_it_adds(self, scenario: Scenario) -> str:  # noqa: ARG002
        """What an AUV can do that one without end of energy could not.

        One line for the bound by energy and travel, which holds for the latter; empty where a
        limit can only remove possibilities.
        """
        return f"vehicle {self.settings.kind!r} does not state that it does"

    def can_only_remove(self, scenario: Scenario) -> bool:
        """Whether all that AUVs can do they could do with energy without end."""
        return not self.what_it_adds(scenario)

    @abstractmethod
    def propulsion_power_w(self, speed_m_per_s: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Power of moving at a speed through the water, in W: 0 at rest; of NumPy, any shape."""

    def setup(self, world: Context) -> None:
        super().setup(world)
        scenario, floats, slot_s = world.scenario, world.backend.floats, world.link.slot_s
        self._columns = scenario.num_auvs if self.is_limited else 0
        backend = world.backend
        #: Who is stranded where nobody can be.
        self.none_stranded = backend.zeros((world.num_envs, self._columns)) > 0
        self._dock_cells: Array | None = None
        if world.current is not None:
            self._set_up_current(world, world.current)
        if not self.is_limited:
            return
        # By offset, of one slot: the slots that a move takes are the time of it.
        slots = self._slots_by_offset(world)
        whole_way_m = world.grid.offset_distances_m()
        way_m = whole_way_m / slots
        power_w = np.asarray(self.propulsion_power_w(way_m / slot_s), dtype=np.float64)
        self._move_j, self._way_m = floats(power_w * slot_s), floats(way_m)
        #: Of who drifts; None where every move is over in a slot.
        self._whole_way_m = floats(whole_way_m) if (slots > 1).any() else None
        self._slots = world.backend.integers(slots)
        self._hotel_j = floats(self.hotel_w * slot_s)
        self._zero = floats(0.0)
        self._charging_w = floats(scenario.charging.power_w)
        self._capacity_j = floats(self.capacity_j)
        dock_j = np.zeros(world.grid.num_codes)
        if self.docks:
            dock_j[world.grid.encode(np.array(self.docks) - 1)] = self.dock_power_w * slot_s
        self._dock_j = floats(dock_j)

    @staticmethod
    def _slots_by_offset(world: Context) -> npt.NDArray[np.int64]:
        pace, steps = Pace.from_scenario(world.scenario), world.scenario.auvs.motion.part.steps
        return pace.by_offset(world.grid, steps)

    def _set_up_current(self, world: Context, current: CurrentField) -> None:
        """Tables for what moves cost, and whether they are possible, in a current."""
        floats, limit = world.backend.floats, self.max_speed_m_per_s
        self._max_speed = None if limit is None else floats(limit * _SPEED_ROUNDING)
        top = max(current.fastest_m_per_s, SMALLEST)
        speeds = np.linspace(0.0, top, SPEED_INTERVALS + 2)
        power_w = np.asarray(self.propulsion_power_w(speeds), dtype=np.float64)
        self._top_speed = floats(top)
        ground = world.grid.offset_distances_m() / self._slots_by_offset(world)
        dearest = np.minimum(ground / world.link.slot_s + current.strongest_m_per_s, top)
        power_at = np.asarray(self.propulsion_power_w(dearest), dtype=np.float64)
        self._dearest_j = floats(power_at * world.link.slot_s)
        self._intervals_per_speed = floats((SPEED_INTERVALS + 1) / top)
        self._speed_j = floats(power_w[:-1] * world.link.slot_s)
        self._step_j = floats(np.diff(power_w) * world.link.slot_s)
        self._last_interval = world.backend.integers(SPEED_INTERVALS)
        if self.docks:
            is_dock = np.zeros(world.grid.num_codes, dtype=np.bool_)
            is_dock[world.grid.encode(np.array(self.docks) - 1)] = True
            self._dock_cells = self.xp.asarray(is_dock, device=world.backend.device)

    def is_fast_enough(self, speed: Array) -> Array:
        """Which speeds through the water are no higher than the vehicle's highest."""
        return speed <= (self._top_speed if self._max_speed is None else self._max_speed)

    def can_pay(self, state: State, energy_j: Array) -> Array:
        """Which AUVs have so much beside the hotel load, (envs, auvs)."""
        return state.battery_j - self._hotel_j >= energy_j

    def paid_j(self, state: State, energy_j: Array, idle: Array) -> Array:
        """What propulsion takes in a current, (envs, auvs) in J.

        No more than the battery has beside the hotel load: an AUV that another one stops holds its
        cell as long as it can.

        Args:
            state: the state before the slot.
            energy_j: (envs, auvs) what is asked for.
            idle: (envs, auvs) bool, whose propulsion rests.
        """
        energy_j = self.xp.minimum(energy_j, state.battery_j - self._hotel_j)
        return self.xp.where(idle, self._zero, energy_j)

    def is_moored(self, cell: Array) -> Array | None:
        """Which AUVs lie in docks, (envs, auvs), and need not hold their cells; None for nobody."""
        return None if self._dock_cells is None else lookup(self.xp, self._dock_cells, cell)

    def swimming_j(self, speed: Array) -> Array:
        """What a slot at speeds through the water takes, in J."""
        xp = self.xp
        place = xp.minimum(speed, self._top_speed) * self._intervals_per_speed
        interval = xp.minimum(cast(xp, place, xp.int64), self._last_interval)
        share = place - cast(xp, interval, place.dtype)
        return lookup(xp, self._speed_j, interval) + share * lookup(xp, self._step_j, interval)

    def is_stranded(self, battery_j: Array) -> Array:
        """Whether AUVs that begin a slot with this can do nothing in it, (envs, auvs) bool."""
        return (battery_j < self._hotel_j) | (battery_j <= self._zero)

    def stays(self, state: State, target: Array) -> Array:
        """Which AUVs cannot pay for a slot of the move to their (envs, auvs) targets."""
        battery_j = state.battery_j
        return self.is_stranded(battery_j) | (
            battery_j - self._hotel_j < self.propulsion_j(state.cell, target)
        )

    def can_charge(
        self, state: State, heading: Array, charging_s: Array, propulsion_j: Array | None = None
    ) -> Array:
        """Which AUVs can pay for charging for so long, beside moving to (envs, auvs) cells.

        In a current `propulsion_j` is what that takes.
        """
        if propulsion_j is None:
            propulsion_j = self.propulsion_j(state.cell, heading)
        left_j = state.battery_j - self._hotel_j - propulsion_j
        return left_j >= charging_s * self._charging_w

    def propulsion_j(self, cell: Array, heading: Array) -> Array:
        """What a slot of the moves from cells to cells takes in still water, (envs, auvs) in J."""
        return lookup(self.xp, self._move_j, self.world.link.grid_offset(heading, cell))

    def dearest_j(self, cell: Array, heading: Array) -> Array:
        """What a slot of the moves from cells to cells takes at most in the current, alike."""
        return lookup(self.xp, self._dearest_j, self.world.link.grid_offset(heading, cell))

    def slots(self, cell: Array, heading: Array) -> Array:
        """How many slots the moves from cells to cells take, (envs, auvs)."""
        return lookup(self.xp, self._slots, self.world.link.grid_offset(heading, cell))

    def first(self, num_envs: int) -> dict[str, Array]:
        """Fields of the first state of an episode."""
        nothing = self.world.backend.zeros((num_envs, self._columns))
        fields = dict.fromkeys(VEHICLE_FIELDS, nothing)
        return fields | {"battery_j": nothing + (self.initial_j if self.is_limited else 0.0)}

    def after(
        self,
        state: State,
        cell: Array,
        heading: Array,
        stranded: Array,
        charging_s: Array,
        propulsion_j: Array | None = None,
        idle: Array | None = None,
    ) -> tuple[dict[str, Array], Array]:
        """Fields of the state after a slot, and what was drawn in it, (envs, auvs) in J.

        Args:
            state: the state before it.
            cell: (envs, auvs) codes of the AUVs' cells after it.
            heading: the cells that AUVs go to whose moves are not over, those of the others.
            stranded: (envs, auvs) bool, `is_stranded` of that state.
            charging_s: (envs, auvs) how long they have charged.
            propulsion_j, idle: in a current what propulsion takes, and whose rests.
        """
        if not self.is_limited:
            return self._as_before(state), state.battery_j
        xp, offset = self.xp, self.world.link.grid_offset(heading, state.cell)
        hotel_j = xp.where(stranded, state.battery_j, self._hotel_j)
        way_m = lookup(xp, self._way_m, offset)
        if propulsion_j is None:
            propulsion_j = lookup(xp, self._move_j, offset)
        if idle is not None and self._whole_way_m is not None:
            # Who drifts does so within the slot, however long a move to there would take.
            way_m = xp.where(idle, lookup(xp, self._whole_way_m, offset), way_m)
        charging_j = charging_s * self._charging_w
        # In the order in which `stays` and `can_charge` subtract, so that nothing is overdrawn.
        left_j = state.battery_j - hotel_j - propulsion_j - charging_j
        battery_j, all_docked_j = left_j, state.docked_j
        if self.docks:
            dock_j = lookup(xp, self._dock_j, cell)
            if heading is not cell:
                dock_j = xp.where(heading == cell, dock_j, self._zero)
            docked_j = xp.minimum(self._capacity_j - left_j, dock_j)
            # What fills it up may pass its capacity by a rounding.
            battery_j = xp.minimum(left_j + docked_j, self._capacity_j)
            all_docked_j = state.docked_j + docked_j
        fields = {
            "battery_j": battery_j,
            "propulsion_j": state.propulsion_j + propulsion_j,
            "hotel_j": state.hotel_j + hotel_j,
            "charging_j": state.charging_j + charging_j,
            "docked_j": all_docked_j,
            "distance_m": state.distance_m + way_m,
            "stranded_slots": state.stranded_slots + cast(xp, stranded, left_j.dtype),
        }
        return fields, hotel_j + propulsion_j + charging_j

    def _as_before(self, state: State) -> dict[str, Array]:
        # One by one: a loop over their names would take a twentieth of a slot.
        return {
            "battery_j": state.battery_j,
            "propulsion_j": state.propulsion_j,
            "hotel_j": state.hotel_j,
            "charging_j": state.charging_j,
            "docked_j": state.docked_j,
            "distance_m": state.distance_m,
            "stranded_slots": state.stranded_slots,
        }


vehicles: Registry[type[Vehicle]] = Registry("vehicle", Vehicle)
