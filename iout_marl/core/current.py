"""The current of the water in every cell and slot, and speeds of AUVs through it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from iout_marl.arrays.backend import Backend
from iout_marl.core.chance import Chance
from iout_marl.core.grid import Floats, Grid
from iout_marl.core.pace import Pace
from iout_marl.core.state import State
from iout_marl.core.wandering import Wandering
from iout_marl.physics.arrays import Array, lookup
from iout_marl.scenario import Scenario

#: Velocities of all frames and codes of cells that a world's tables may have, slots of a current
#: that changes.
MAX_VELOCITIES, MAX_SLOTS = 10**7, 10**7
#: Velocities in tables by slot and cell; of more, frames are interpolated slot by slot.
_MOST_BY_SLOT = 2**20
#: Standard deviations beyond which chance adds nothing to a current.
CUT_OFF = 4.0


class Frames(NamedTuple):
    """A current as a few fields, between two of which that of any slot lies.

    Attributes:
        velocity_m_per_s: (frames, cells, 2) along x and y, of the cells of
            `Grid.all_coordinates`.
        frame: (slots,) int: the earlier of a slot's two frames, the other is the next one.
        weight: (slots,) the share of the later one, from 0 to 1. Of a steady current, which has one
            frame, both are empty.
    """

    velocity_m_per_s: Floats
    frame: npt.NDArray[np.int64]
    weight: Floats

    @classmethod
    def from_steady(cls, velocity_m_per_s: Floats) -> Frames:
        """A (cells, 2) field that never changes."""
        return cls(velocity_m_per_s[None], np.zeros(0, dtype=np.int64), np.zeros(0))

    @property
    def is_steady(self) -> bool:
        return len(self.velocity_m_per_s) == 1

    def slots(self) -> range:
        """The slots whose fields differ: the first stands for all of a steady current."""
        return range(1 if self.is_steady else len(self.frame))

    def field(self, slot: int) -> Floats:
        """(cells, 2) velocities of a slot in m/s."""
        if self.is_steady:
            return self.velocity_m_per_s[0]
        first, second = self.velocity_m_per_s[self.frame[slot] : self.frame[slot] + 2]
        velocity: Floats = first + self.weight[slot] * (second - first)
        return velocity

    def by_slot(self) -> Frames:
        """The same with a frame for each slot, of a current that changes."""
        fields = np.stack([self.field(slot) for slot in self.slots()])
        slots = len(self.frame)
        return Frames(fields, np.arange(slots), np.zeros(slots))

    def strongest_m_per_s(self) -> float:
        """A speed that the current exceeds in no cell and no slot."""
        return float(np.linalg.norm(self.velocity_m_per_s, axis=-1).max())


class Wander(NamedTuple):
    """What chance adds to either component of a current, the same in all cells."""

    sigma_m_per_s: float  # its standard deviation
    coherence_s: float  # T, after which its correlation has fallen to 1/e; see `Wandering`

    @property
    def most_m_per_s(self) -> float:
        """Where either component is cut off, so that the current has a highest speed."""
        return CUT_OFF * self.sigma_m_per_s


class CurrentField:
    """The current in a world: what AUVs move in.

    The current of a slot is that in its middle, in the cell where the AUV is when the slot begins;
    the AUV's velocity over ground is the way of the slot over its length.

    Args:
        scenario: the scenario, whose current flows.
        grid: its grid.
        backend: arrays to work with.

    Attributes:
        strongest_m_per_s: a speed that the current never exceeds.
        fastest_m_per_s: a speed through the water that no move exceeds.
    """

    def __init__(self, scenario: Scenario, grid: Grid, backend: Backend) -> None:
        frames: Frames = scenario.current.part.frames(scenario)
        strongest = scenario.current.part.strongest_m_per_s(scenario, frames)
        if not frames.is_steady and len(frames.frame) * grid.num_codes <= _MOST_BY_SLOT:
            frames = frames.by_slot()
        self._xp = backend.xp
        self._origin = backend.integers(grid.offset_origin)
        self._num_codes = backend.integers(grid.num_codes)
        codes = grid.encode(grid.all_coordinates())
        table = np.zeros((len(frames.velocity_m_per_s), grid.num_codes, 2))
        table[:, codes] = frames.velocity_m_per_s
        # Flattened, not viewed: NumPy would copy a table whose entries lie apart at each look-up.
        self._velocity = [backend.floats(table[..., axis].flatten()) for axis in (0, 1)]
        self._is_steady = frames.is_steady
        self._wandering: Wandering | None = None
        if (wander := scenario.current.part.wander(scenario)) is not None:
            self._wandering = Wandering(
                backend,
                wander.sigma_m_per_s,
                wander.coherence_s,
                scenario.slot_s,
                wander.most_m_per_s,
            )
        self._backend = backend
        if not self._is_steady:
            # What is seen after the last slot is seen of it.
            last = np.minimum(np.arange(scenario.num_slots + 1), scenario.num_slots - 1)
            self._row = backend.integers(frames.frame[last] * grid.num_codes)
            self._weight = backend.floats(frames.weight[last]) if frames.weight.any() else None
        steps = np.array(scenario.auvs.motion.part.steps)
        pace = Pace.from_scenario(scenario)
        self.strongest_m_per_s = strongest
        fastest = float(grid.metres(steps * pace.cells[:, None]).max()) / scenario.slot_s
        self.fastest_m_per_s = fastest + self.strongest_m_per_s
        slots_s = (pace.by_offset(grid, steps) * scenario.slot_s)[:, None]
        over_ground = grid.offset_steps() * np.array(grid.edges_m) / slots_s
        self._over_ground = [backend.floats(over_ground[:, axis]) for axis in (0, 1)]
        self._vertical_squared = backend.floats(over_ground[:, 2] ** 2)

    def first(self, num_envs: int, normal: Array | None = None) -> Array:
        """What chance adds in the first slot: (envs, 2) in m/s, or (envs, 0) where it never does.

        Args:
            num_envs: environments.
            normal: (envs, 2) what is drawn for it; None for 0, the mean of the current.
        """
        backend = self._backend
        if self._wandering is None or normal is None:
            return backend.zeros((num_envs, 0 if self._wandering is None else 2))
        return self._wandering.first(backend.with_envs_inside(backend.floats(normal)))

    def after(self, state: State, chance: Chance | None) -> Array:
        """What chance adds in the slot that comes next, alike."""
        if self._wandering is None:
            return state.wander_m_per_s
        assert chance is not None  # or `World.step` has refused it
        return self._wandering.following(state.wander_m_per_s, chance.current)

    def at(self, state: State) -> tuple[Array, Array]:
        """The current along x and y in m/s, (envs, auvs) each, in the slot that begins.

        After the last slot it is that of the last, but for what chance adds.
        """
        x, y = self._by_tables(state.slot, state.cell)
        if self._wandering is not None:
            x, y = x + state.wander_m_per_s[:, :1], y + state.wander_m_per_s[:, 1:]
        return x, y

    def _by_tables(self, slot: Array, cell: Array) -> tuple[Array, Array]:
        xp = self._xp
        if self._is_steady:
            x, y = (lookup(xp, table, cell) for table in self._velocity)
            return x, y
        first = lookup(xp, self._row, slot)[:, None] + cell
        if self._weight is None:
            x, y = (lookup(xp, table, first) for table in self._velocity)
            return x, y
        second, weight = first + self._num_codes, lookup(xp, self._weight, slot)[:, None]
        x, y = (
            (before := lookup(xp, table, first)) + weight * (lookup(xp, table, second) - before)
            for table in self._velocity
        )
        return x, y

    def speed_to_hold(self, flow: tuple[Array, Array]) -> Array:
        """Speed through the water of AUVs that hold their cells, in m/s; `flow` is of `at`."""
        x, y = flow
        return self._xp.sqrt(x * x + y * y)

    def speed_to_move(self, flow: tuple[Array, Array], cell: Array, heading: Array) -> Array:
        """Speed through the water in m/s with which AUVs make good a slot of moves.

        Args:
            flow: the current that they are in, of `at`.
            cell: (envs, auvs) cells that they are in.
            heading: cells that they move to, (envs, auvs), or (envs, auvs, choices).

        Returns:
            in the shape of `heading`.
        """
        xp, (x, y) = self._xp, flow
        if heading.ndim > cell.ndim:
            x, y, cell = x[..., None], y[..., None], cell[..., None]
        offset = heading - cell + self._origin
        x = lookup(xp, self._over_ground[0], offset) - x
        y = lookup(xp, self._over_ground[1], offset) - y
        return xp.sqrt(x * x + y * y + lookup(xp, self._vertical_squared, offset))
