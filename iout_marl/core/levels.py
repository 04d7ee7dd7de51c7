"""Stored energy in levels, rounded so that a node is never poorer than in the world.

A level stands for any stored energy up to it; the last is without limit. Whatever a slot does to
the energy leads to the lowest level that is not below what the world would come to. A node may
also throw energy away: so more energy is never worse, in TDD too, where the rules for β would at
times serve a poorer node better.

Bounds are searched for on these levels, in floating-point numbers, and checked on those of
`whole_levels`. What a slot does to them, duplex parts state.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from iout_marl.core.limits import DEAREST_J

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

#: No level or affordable uplink comes near to this many joules.
BEYOND_J = 1e100


class Tables(NamedTuple):
    """Where a slot takes the level of a node, (nodes, cells, levels) each.

    Entries are levels; the number of levels stands for what cannot be. `both` is charging
    and delivery in one slot; it is not there where an AUV names one node: there `deliver` and
    `charge` are the two outcomes of naming it.
    """

    charge: Integers
    deliver: Integers
    both: Integers | None


class EnergyLevels(NamedTuple):
    """Levels of stored energy for a search."""

    levels_j: Floats  # (levels,) J, from 0 to infinity
    tolerance_j: float  # by how much the world's energies may exceed a level

    def level(self, energy_j: Floats) -> Integers:
        """The lowest level that is not below."""
        return np.searchsorted(self.levels_j, energy_j).astype(np.int64)

    def paid(self, energy_j: Floats, price_j: Floats) -> Integers:
        """The level after a payment; the number of levels where the energy cannot pay."""
        pays = (energy_j + self.tolerance_j > price_j) & (price_j < DEAREST_J)
        left_j = np.maximum(energy_j - price_j, 0.0)
        return np.where(pays, self.level(left_j), len(self.levels_j))

    @property
    def below_j(self) -> Floats:
        """(levels,) the least energy that each level stands for."""
        return np.maximum(np.concatenate([[0.0], self.levels_j[:-1]]) - self.tolerance_j, 0.0)

    def with_disposal(self, deliver: Integers, charge: Integers) -> Tables:
        """The best that a node at a level, or at any below it, comes to; −1 is for nothing."""
        num_levels = deliver.shape[-1]
        best = [np.maximum.accumulate(table, axis=-1) for table in (charge, deliver)]
        charge, deliver = (np.where(table < 0, num_levels, table) for table in best)
        return Tables(charge=charge, deliver=deliver, both=None)
