"""What becomes of the directions that AUVs name: by their batteries, and in the current."""

from __future__ import annotations

from iout_marl.core.current import CurrentField
from iout_marl.core.state import State
from iout_marl.parts import Context, Vehicle
from iout_marl.physics.arrays import Array
from iout_marl.world.motion import Moved, Mover


class Manoeuvre:
    """Moves AUVs as far as their energy and their speed through the water allow.

    An AUV that cannot pay for its move stays where it is. In a current, one that cannot make its
    move good, for want of energy or of speed, gives it up and holds its cell; one that cannot do
    that either drifts, one step of the grid along the axis of the stronger current (x of two like
    ones), and at the edge lies aground. One that is stranded lies on the bottom.

    Args:
        context: the world.
        motion: its moves.
        vehicle: its vehicles.
    """

    def __init__(self, context: Context, motion: Mover, vehicle: Vehicle) -> None:
        self._backend = backend = context.backend
        self._xp = backend.xp
        self._motion, self._vehicle, self._current = motion, vehicle, context.current
        self._zero = backend.floats(0.0)
        self._drifts = [backend.integers(i) for i in range(4)]

    def move(self, state: State, direction: Array, stranded: Array | None = None) -> Moved:
        """One slot's moves, see `Mover.move`.

        Args:
            state: the state before the slot.
            direction: (envs, auvs) indices of directions.
            stranded: (envs, auvs) bool, `Vehicle.is_stranded` of the state where it is known.
        """
        motion, vehicle = self._motion, self._vehicle
        if self._current is None:
            stays = None
            if vehicle.is_limited:
                stays = vehicle.stays(state, motion.targets(state, direction))
            return motion.move(state, direction, stays)
        return self._in_current(self._current, state, direction, stranded)

    def _in_current(
        self, current: CurrentField, state: State, direction: Array, stranded: Array | None
    ) -> Moved:
        xp, motion, vehicle, cell = self._xp, self._motion, self._vehicle, state.cell
        flow, target = current.at(state), motion.targets(state, direction)
        hold_speed = current.speed_to_hold(flow)
        move_speed = current.speed_to_move(flow, cell, target)
        holds, goes = vehicle.is_fast_enough(hold_speed), vehicle.is_fast_enough(move_speed)
        moored = vehicle.is_moored(cell)
        if vehicle.is_limited:
            hold_j, move_j = vehicle.swimming_j(hold_speed), vehicle.swimming_j(move_speed)
            if moored is not None:
                hold_j = xp.where(moored, self._zero, hold_j)
            holds = holds & vehicle.can_pay(state, hold_j)
            goes = goes & vehicle.can_pay(state, move_j)
        if moored is not None:
            holds = holds | moored
            goes = goes | (moored & (target == cell))
        stays, drifts = ~goes, ~(goes | holds)
        idle = drifts
        if vehicle.is_limited:
            if stranded is None:
                stranded = vehicle.is_stranded(state.battery_j)
            stays, drifts, idle = stays | stranded, drifts & ~stranded, drifts | stranded
        carried = None
        if not self._backend.surely_none(drifts):
            carried = drifts, self._where_to(flow)
        moved = motion.move(state, direction, stays, carried)
        moved = moved._replace(idle=idle)
        if not vehicle.is_limited:
            return moved
        heading = motion.heading(moved)
        if motion.ends_in_between:
            move_j = vehicle.swimming_j(current.speed_to_move(flow, cell, heading))
        asked_j = xp.where(heading == cell, hold_j, move_j)
        return moved._replace(propulsion_j=vehicle.paid_j(state, asked_j, idle))

    def possible(self, state: State) -> Array | None:
        """Which directions the speed suffices for: (envs, auvs, directions) bool; None for all."""
        if self._current is None:
            return None
        current, cell = self._current, state.cell
        flow, heading = current.at(state), self._motion.neighbours(cell)
        return self._vehicle.is_fast_enough(current.speed_to_move(flow, cell, heading))

    def open(self, state: State) -> Array:
        """Which directions keep an AUV in the grid and are possible, alike."""
        inside, possible = self._motion.stays_inside(state.cell), self.possible(state)
        return inside if possible is None else inside & possible

    def sensible(self, state: State) -> Array:
        """Which directions make sense: those of `Mover.sensible` that are possible."""
        return self._motion.sensible(state, self.possible(state))

    def reachable(self, state: State) -> Array:
        """Where an AUV may be at the end of the slot: (envs, auvs, choices) codes."""
        cells = self._motion.reachable(state)
        if self._current is None:
            return cells
        where_to = self._where_to(self._current.at(state))
        drifted = self._motion.drifted(state.cell, where_to)
        return self._xp.concat([cells, state.cell[..., None], drifted[..., None]], axis=-1)

    def _where_to(self, flow: tuple[Array, Array]) -> Array:
        """Where currents carry AUVs, (envs, auvs) indices into `DRIFTS`."""
        xp, (x, y) = self._xp, flow
        right, left, ahead, back = self._drifts
        along_x = xp.where(x < self._zero, left, right)
        along_y = xp.where(y < self._zero, back, ahead)
        return xp.where(x * x >= y * y, along_x, along_y)
