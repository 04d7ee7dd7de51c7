"""What becomes of the directions that AUVs name: by their batteries, and in the current."""

from __future__ import annotations

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
        backend = context.backend
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
        stays = ~vehicle.can_make_good(state, motion.targets(state, direction))
        drifts = stays & ~vehicle.can_make_good(state, state.cell)
        idle = drifts
        if vehicle.is_limited:
            if stranded is None:
                stranded = vehicle.is_stranded(state.battery_j)
            stays, drifts, idle = stays | stranded, drifts & ~stranded, idle | stranded
        moved = motion.move(state, direction, stays, (drifts, self._where_to(state)))
        return moved._replace(idle=idle)

    def possible(self, state: State) -> Array | None:
        """Which directions the speed suffices for: (envs, auvs, directions) bool; None for all."""
        if self._current is None:
            return None
        return self._vehicle.is_fast_enough(state, self._motion.neighbours(state.cell))

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
        drifted = self._motion.drifted(state.cell, self._where_to(state))
        return self._xp.concat([cells, state.cell[..., None], drifted[..., None]], axis=-1)

    def _where_to(self, state: State) -> Array:
        """Where the current carries AUVs, (envs, auvs) indices into `DRIFTS`."""
        assert self._current is not None
        xp, (x, y) = self._xp, self._current.at(state.slot, state.cell)
        right, left, ahead, back = self._drifts
        along_x = xp.where(x < self._zero, left, right)
        along_y = xp.where(y < self._zero, back, ahead)
        return xp.where(x * x >= y * y, along_x, along_y)
