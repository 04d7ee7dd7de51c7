"""Motion: where a direction takes an AUV, and when."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from iout_marl.arrays.backend import Backend
from iout_marl.core.grid import Grid
from iout_marl.core.pace import Pace
from iout_marl.core.state import State
from iout_marl.parts.current import DRIFTS
from iout_marl.physics.arrays import Array, lookup
from iout_marl.scenario import Scenario


class Moved(NamedTuple):
    """What has become of the AUVs' moves at the end of a slot.

    Transit and course are fields of the state: without columns where no move takes longer than a
    slot.
    """

    cell: Array  # (envs, auvs) int: codes of their cells
    left_grid: Array  # (envs, auvs) bool: would have left the grid
    blocked: Array  # (envs, auvs) bool: kept from moving by another AUV
    transit_slots: Array  # (envs, auvs) int: slots until the move ends; 0 for nobody under way
    course: Array  # (envs, auvs) int: its direction
    # In a current, else None: (envs, auvs) bool, lying still or adrift, without propulsion; and
    # where there are batteries, (envs, auvs) float, J: what that takes.
    idle: Array | None = None
    propulsion_j: Array | None = None


class Mover:
    """Moves AUVs from cell to cell.

    In a grid of one cell there is nowhere to go: every direction stays, and none leaves the grid.

    A move that takes several slots is made as a whole: until it ends the AUV counts as in the cell
    that it leaves, and the directions named meanwhile are ignored. One that covers several cells
    in a slot stops at the edge of the grid.

    Args:
        scenario: the scenario: its motion, its pace and its separation.
        grid: its grid.
        backend: arrays to work with.

    Attributes:
        pace: how its moves are made.
        ends_in_between: whether moves over several cells may end before they are over.
        takes_slots: whether any of them takes longer than a slot.
    """

    def __init__(self, scenario: Scenario, grid: Grid, backend: Backend) -> None:
        self.steps = np.array(scenario.auvs.motion.part.steps)
        self.num_directions = len(self.steps)
        self.pace = Pace.from_scenario(scenario)
        self.takes_slots = self.pace.takes_slots
        self.ends_in_between = bool((self.pace.cells > 1).any()) and scenario.num_auvs > 1
        self._num_auvs = scenario.num_auvs
        self._backend = backend
        self._xp = backend.xp
        # Behind the directions come those in which a current carries AUVs away.
        steps, (slots, cells) = self.steps, self.pace
        if scenario.current.part.flows:
            once = np.ones(len(DRIFTS), dtype=np.int64)
            steps = np.concatenate([steps, DRIFTS])
            slots, cells = np.concatenate([slots, once]), np.concatenate([cells, once])
        next_cell, inside = _neighbour_tables(grid, steps)
        self._next = backend.integers(next_cell.reshape(-1))
        self._most_cells = int(self.pace.cells.max())
        self._cells = backend.integers(cells)
        destination = _after_steps(next_cell, cells)
        self.neighbour = backend.integers(destination.reshape(-1))
        self._leads_outside = backend.xp.asarray(~inside.reshape(-1), device=backend.device)
        # Who stays is not under way.
        stays = destination == np.arange(grid.num_codes)[:, None]
        self._slots = backend.integers(np.where(stays, 1, slots).reshape(-1))
        self._num_rows = len(steps)
        self._per_cell = backend.integers(self._num_rows)
        self._first_drift = backend.integers(self.num_directions)
        self._one = backend.integers(1)
        self._never = backend.xp.asarray(False, device=backend.device)  # noqa: FBT003
        separation_cells = scenario.auvs.separation_cells
        self._keeps_apart = separation_cells > 0
        too_near = grid.offset_distances() < separation_cells * (1 - 1e-12)
        self._too_near = backend.xp.asarray(too_near, device=backend.device)
        self._origin = grid.offset_origin

    def first(self, num_envs: int) -> dict[str, Array]:
        """Fields of the first state of an episode."""
        backend, columns = self._backend, self._num_auvs if self.takes_slots else 0
        nothing = backend.xp.zeros(
            (num_envs, columns), dtype=backend.xp.int64, device=backend.device
        )
        return {"transit_slots": nothing, "course": nothing}

    def move(
        self,
        state: State,
        direction: Array,
        stays: Array | None = None,
        drift: tuple[Array, Array] | None = None,
    ) -> Moved:
        """One slot's moves (eq. `direction`), all at once; who would leave the grid stays.

        Of AUVs whose moves would end too near one another, or swap their cells, all that
        move stay; so do those whose moves would then end too near one that stays. The
        order of the AUVs does not matter, and AUVs that were apart stay apart. Moves over several
        cells are made cell by cell, those of all AUVs in step, and who is stopped goes no further.
        Who arrives after several slots and is stopped is back in the cell that it has left.

        Args:
            state: the state before the slot, of any number of environments.
            direction: (envs, auvs) indices of directions.
            stays: (envs, auvs) bool, who stays whatever its direction, and gives up a move that is
                not over; None for nobody.
            drift: (envs, auvs) bool, which of those drift instead, and indices into `DRIFTS` of
                where to; None for nobody.
        """
        xp, cell, transit_slots = self._xp, state.cell, state.transit_slots
        course = state.course
        if self.takes_slots:
            under_way = transit_slots > 0
            direction = course = xp.where(under_way, course, direction)
        index = cell * self._per_cell + direction
        left_grid = lookup(xp, self._leads_outside, index)
        target = lookup(xp, self.neighbour, index)
        if self.takes_slots:
            needed = xp.where(under_way, transit_slots, lookup(xp, self._slots, index))
            if stays is not None:
                needed = xp.where(stays, self._one, needed)
            target = xp.where(needed > self._one, cell, target)
            transit_slots = needed - self._one
        if stays is not None:
            left_grid, target = left_grid & ~stays, xp.where(stays, cell, target)
        if drift is not None:
            drifts, where_to = drift
            direction = xp.where(drifts, where_to + self._first_drift, direction)
            carried = lookup(xp, self.neighbour, cell * self._per_cell + direction)
            target = xp.where(drifts, carried, target)
        if cell.shape[1] == 1 or not self._keeps_apart:
            return Moved(target, left_grid, left_grid & self._never, transit_slots, course)
        if self._most_cells == 1:
            new_cell = self._apart(cell, target)
        else:
            new_cell = self._apart_by_cells(cell, direction, target)
        return Moved(new_cell, left_grid, new_cell != target, transit_slots, course)

    def _apart_by_cells(self, cell: Array, direction: Array, target: Array) -> Array:
        """Where moves over several cells end."""
        xp, moves = self._xp, target != cell
        num_cells = lookup(xp, self._cells, direction)
        for done in range(self._most_cells):
            ahead = lookup(xp, self._next, cell * self._per_cell + direction)
            ahead = xp.where(moves & (num_cells > done), ahead, cell)
            cell = self._apart(cell, ahead)
            moves = moves & (cell == ahead)
        return cell

    def _apart(self, cell: Array, target: Array) -> Array:
        """The targets of all that can move, the old cells of the others."""
        xp = self._xp
        auvs = xp.arange(cell.shape[1], device=cell.device)
        another = auvs[:, None] != auvs[None, :]
        new_cell = target
        # Whoever stops may stop another: a chain of all AUVs takes as many rounds.
        for _ in range(cell.shape[1]):
            near = lookup(xp, self._too_near, self._between(new_cell, new_cell))
            swaps = self._between(new_cell, cell) == self._origin
            swaps = swaps & xp.matrix_transpose(swaps)
            moves = new_cell != cell
            stops = moves & xp.any((near | (swaps & moves[:, None, :])) & another, axis=2)
            if self._backend.surely_none(stops):
                break
            new_cell = xp.where(stops, cell, new_cell)
        return new_cell

    def _between(self, first: Array, second: Array) -> Array:
        """Code differences + origin of every pair: (envs, auvs, auvs)."""
        return first[:, :, None] - second[:, None, :] + self._origin

    def stays_inside(self, cell: Array) -> Array:
        """Which directions keep an AUV in the grid: (envs, auvs, directions) bool."""
        return ~lookup(self._xp, self._leads_outside, self._every_direction(cell))

    def sensible(self, state: State, possible: Array | None = None) -> Array:
        """Which directions make sense: (envs, auvs, directions) bool.

        Those that keep an AUV in the grid; of one that is under way, which ignores them, the first.

        Args:
            state: the state.
            possible: those that the current allows, alike; None for all.
        """
        inside = self.stays_inside(state.cell)
        if possible is not None:
            inside = inside & possible
        if not self.takes_slots:
            return inside
        directions = self._xp.arange(self.num_directions, device=state.cell.device)
        is_first = directions == 0
        return self._xp.where(state.transit_slots[..., None] > 0, is_first, inside)

    def are_near(self, cell: Array, other: Array) -> Array:
        """Whether AUVs may not be in both cells at a time, of codes that broadcast."""
        if not self._keeps_apart:
            return (cell != cell) | (other != other)
        return lookup(self._xp, self._too_near, cell - other + self._origin)

    def neighbours(self, cell: Array) -> Array:
        """The cell that a move in each direction ends in: (envs, auvs, directions) codes."""
        return lookup(self._xp, self.neighbour, self._every_direction(cell))

    def next_cells(self, cell: Array) -> Array:
        """Where an AUV that was in a cell can be a slot later, more at most: (…, choices) codes.

        Where moves take several slots, each may as well end at once, and the AUV stay.
        """
        neighbours = self.neighbours(cell)
        if not self.takes_slots:
            return neighbours
        return self._xp.concat([neighbours, cell[..., None]], axis=-1)

    def reachable(self, state: State) -> Array:
        """Where an AUV is at the end of the slot by each direction: (envs, auvs, directions)."""
        neighbours = self.neighbours(state.cell)
        if not self.takes_slots:
            return neighbours
        xp, cell = self._xp, state.cell[..., None]
        under_way, slots = state.transit_slots[..., None] > 0, state.transit_slots[..., None]
        needed = lookup(xp, self._slots, self._every_direction(state.cell))
        needed = xp.where(under_way, slots, needed)
        neighbours = xp.where(under_way, self.heading(state)[..., None], neighbours)
        return xp.where(needed > self._one, cell, neighbours)

    def heading(self, at: State | Moved) -> Array:
        """The cells that AUVs under way go to, and those that others are in: (envs, auvs)."""
        if not self.takes_slots:
            return at.cell
        target = lookup(self._xp, self.neighbour, at.cell * self._per_cell + at.course)
        return self._xp.where(at.transit_slots > 0, target, at.cell)

    def progress(self, state: State) -> Array:
        """Share of its move that each AUV under way has behind it, 0 for others: (envs, auvs)."""
        index = state.cell * self._per_cell + state.course
        done = 1 - state.transit_slots / lookup(self._xp, self._slots, index)
        return self._xp.where(state.transit_slots > 0, done, 0.0)

    def targets(self, state: State, direction: Array) -> Array:
        """The cells that AUVs head for in a slot in which they name these: (envs, auvs)."""
        target = lookup(self._xp, self.neighbour, state.cell * self._per_cell + direction)
        if not self.takes_slots:
            return target
        return self._xp.where(state.transit_slots > 0, self.heading(state), target)

    def _every_direction(self, cell: Array) -> Array:
        """Index into the tables of each direction from each cell."""
        directions = self._xp.arange(self.num_directions, device=cell.device)
        return cell[..., None] * self._num_rows + directions

    def drifted(self, cell: Array, where_to: Array) -> Array:
        """The cells to which the current carries AUVs: (envs, auvs) codes.

        Args:
            cell: where they are.
            where_to: (envs, auvs) indices into `DRIFTS`.
        """
        index = cell * self._per_cell + where_to + self._first_drift
        return lookup(self._xp, self.neighbour, index)


def _neighbour_tables(
    grid: Grid, steps: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
    """Where each direction leads, the own cell at the edge, and whether it stays in the grid.

    Both are (codes, directions).
    """
    cells = grid.all_coordinates()
    targets = cells[:, None, :] + steps
    inside = ((targets >= 0) & (targets < np.array(grid.shape))).all(-1)
    here = grid.encode(cells)
    code = np.zeros((grid.num_codes, len(steps)), dtype=np.int64)
    code[here] = np.where(inside, grid.encode(targets), here[:, None])
    is_inside = np.zeros(code.shape, dtype=np.bool_)
    is_inside[here] = inside | (grid.num_cells == 1)
    return code, is_inside


def _after_steps(
    next_cell: npt.NDArray[np.int64], counts: Sequence[int] | npt.NDArray[np.int64]
) -> npt.NDArray[np.int64]:
    """Where so many steps in each direction end, up to the edge: (codes, directions)."""
    ends = next_cell.copy()
    for direction, count in enumerate(counts):
        for _ in range(int(count) - 1):
            ends[:, direction] = next_cell[ends[:, direction], direction]
    return ends
