"""How far AUVs come within a slot, and how many slots a move takes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from iout_marl.core.grid import Grid
from iout_marl.scenario import Scenario

Integers = npt.NDArray[np.int64]

#: A quotient such as 0.3/0.1 may miss its whole number by a rounding.
_ROUNDING = 1e-12


class Pace(NamedTuple):
    """Of each direction, (directions,) each, how its moves are made."""

    slots: Integers  # from the choice to the arrival; 1 where a slot is long enough
    cells: Integers  # times its step that a slot covers; 1 where a move takes several slots

    @classmethod
    def from_scenario(cls, scenario: Scenario) -> Pace:
        """The pace of a scenario's AUVs along the directions of its motion.

        Where the length of a slot follows from the speed, every move takes one slot and leads one
        step on, whatever the direction. Where `episode.slot_s` gives it, a step of length d takes
        ⌈d/(v τ)⌉ slots, or ⌊v τ/d⌋ of them are made in a slot.
        """
        steps = np.array(scenario.auvs.motion.part.steps)
        if scenario.episode.slot_s is None:
            ones = np.ones(len(steps), dtype=np.int64)
            return cls(ones, ones)
        grid = Grid.from_scenario(scenario)
        reach_m = scenario.auvs.speed_m_per_s * scenario.slot_s
        # More slots than an episode has, or cells than the grid, are all alike.
        longest, farthest = scenario.num_slots + 1, max(grid.shape)
        with np.errstate(all="ignore"):
            slots_a_step = np.nan_to_num(grid.metres(steps) / reach_m, posinf=np.inf)
            slots = np.ceil(slots_a_step * (1 - _ROUNDING))
            cells = np.floor((1 + _ROUNDING) / slots_a_step)
        rests = ~steps.any(axis=1)
        slots, cells = np.clip(slots, 1, longest), np.clip(cells, 1, farthest)
        return cls(
            np.where(rests, 1, slots).astype(np.int64), np.where(rests, 1, cells).astype(np.int64)
        )

    def along_axes(self, steps: Integers) -> Pace:
        """The pace along x, y and z; one cell a slot where no direction leads along an axis alone.

        Args:
            steps: (directions, 3) cells along x, y and z, of each direction.
        """
        slots, cells = np.ones(3, dtype=np.int64), np.ones(3, dtype=np.int64)
        for step, *pace in zip(steps, self.slots, self.cells, strict=True):
            if (step != 0).sum() == 1:
                axis = int(np.flatnonzero(step)[0])
                slots[axis], cells[axis] = pace[0], pace[1] * abs(step[axis])
        return Pace(slots, cells)

    def by_offset(self, grid: Grid, steps: npt.ArrayLike) -> Integers:
        """Slots that a move takes, by code difference + `offset_origin` of its grid."""
        slots = np.ones(2 * grid.num_codes - 1, dtype=np.int64)
        for step, count in zip(np.array(steps), self.slots, strict=True):
            if (abs(step) < np.array(grid.shape)).all():
                slots[grid.encode(step) + grid.offset_origin] = count
        return slots

    @property
    def takes_slots(self) -> bool:
        """Whether any move takes longer than a slot."""
        return bool((self.slots > 1).any())
