"""Stored energy in levels of whole units, for the check of a bound.

Energies are whole numbers of a tiny unit: harvests rounded up, prices of uplinks down, so that no
rounding can make a check too strict for the world. They are Python's, which do not overflow.
Nothing is shared with the search's `levels` but what they stand for.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable
from fractions import Fraction
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

#: The largest harvest of a slot is at least 2 to this many units.
HARVEST_BITS = 60
#: In units, more than any double-precision number of joules is.
BEYOND = 2**2200
#: What the world's floating-point sums may add in a slot, as a share of the energies; as much
#: again is left out where an energy is all but at a level.
ROUNDING = Fraction(1, 10**11)
#: Steps in the search for the best β, each of which leaves 0.62 of an interval: to the last digit.
GOLDEN_STEPS, GOLDEN_RATIO = 90, (math.sqrt(5) - 1) / 2


class WholeLevels(NamedTuple):
    """Levels of stored energy in whole units."""

    units_per_j: Fraction  # a power of two
    levels: list[int]  # without the last
    slack: int  # what is left out in a slot
    tolerance: int  # by how much a node may be richer than its level by the end of an episode

    @classmethod
    def from_joules(
        cls, levels_j: tuple[float, ...], largest_j: float, num_slots: int
    ) -> WholeLevels:
        """The levels, and a unit so small that rounding to it is far below the tolerance.

        A node on a level, not the last, has never had more than that and a harvest.
        """
        units_per_j = Fraction(2) ** (HARVEST_BITS - math.frexp(largest_j)[1] + 1)
        empty = cls(units_per_j, [], 0, 0)
        levels = [empty.down(level) for level in levels_j]
        most = levels[-1] + empty.up(largest_j)
        slack = int(ROUNDING * most) + 1
        return cls(units_per_j, levels, slack, 2 * num_slots * slack)

    def down(self, energy_j: float) -> int:
        """Whole units, rounded down; what is infinite ends at more than any number."""
        if math.isinf(energy_j):
            return BEYOND if energy_j > 0 else -BEYOND
        return math.floor(Fraction(energy_j) * self.units_per_j)

    def up(self, energy_j: float) -> int:
        """Whole units, rounded up."""
        return -self.down(-energy_j)

    def at_least(self, energy: int) -> int:
        """The lowest level that is not below, or by no more than the slack."""
        return bisect_left(self.levels, energy - self.slack)

    @property
    def rungs(self) -> list[tuple[int, int]]:
        """The energies that each level stands for: above the first, up to the second."""
        tops = [*self.levels, 2 * BEYOND]
        return list(zip([0, *self.levels], tops, strict=True))

    def best_so_far(self, table: list[int]) -> list[int]:
        """A node may throw energy away, which makes more of it never worse; −1 is for nothing."""
        best = np.maximum.accumulate(np.array(table))
        return np.where(best < 0, len(self.levels) + 1, best).tolist()


def highest(function: Callable[[Floats], Floats], low: Floats, high: Floats) -> Floats:
    """The highest values of concave functions, one for each entry, by golden sections."""
    best = np.maximum(function(low), function(high))
    for _ in range(GOLDEN_STEPS):
        width = GOLDEN_RATIO * (high - low)
        left, right = function(high - width), function(low + width)
        best = np.maximum(best, np.maximum(left, right))
        rises = left < right
        low, high = np.where(rises, high - width, low), np.where(rises, high, low + width)
    return best
