"""How the quantities of a state are written in observations, and their ranges.

`paper` writes them in cells, slots and joules; `scaled` in [0, 1], energies by e/(e + reference),
where the reference is the energy of an uplink over half the grid's diagonal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from iout_marl.arrays.backend import Backend
from iout_marl.core.grid import Grid
from iout_marl.core.limits import FARTHEST_M, UPLINK_W, bounded, unheard
from iout_marl.core.link import Link
from iout_marl.physics.arrays import Array, lookup, turned
from iout_marl.scenario import Scenario


@dataclass(frozen=True)
class Ranges:
    """Bounds of the entries of an observation, and what makes them of order one.

    `scale` is what a network's input may be divided by, and `limit` where the quotient
    may stop, since energies have no natural bound: past a few uplinks' worth, more
    makes no difference.
    """

    low: npt.NDArray[np.float64]
    high: npt.NDArray[np.float64]
    scale: npt.NDArray[np.float64]
    limit: float = 4.0

    @classmethod
    def alike(cls, size: int, low: float, high: float, scale: float) -> Ranges:
        """The same for so many entries."""
        ones = np.ones(size)
        return cls(low * ones, high * ones, scale * ones)

    @classmethod
    def joined(cls, parts: Sequence[Ranges]) -> Ranges:
        """Those of parts of an observation, one after the other."""
        return cls(
            np.concatenate([part.low for part in parts]),
            np.concatenate([part.high for part in parts]),
            np.concatenate([part.scale for part in parts]),
        )


class Representation:
    """Writes positions, ages, energies, counts and times as a scenario has them seen.

    Args:
        scenario: the scenario.
        grid: its grid.
        link: its links, which bound the energy and give its reference.
        backend: arrays to work with.

    Attributes:
        is_scaled: whether all is written in [0, 1].
        price_j: the reference energy in J.
    """

    def __init__(self, scenario: Scenario, grid: Grid, link: Link, backend: Backend) -> None:
        self.is_scaled = scenario.observation.is_scaled
        self.price_j = _price_j(scenario, link)
        self._xp = backend.xp
        self._dtype = backend.dtype
        self._num_nodes, self._num_slots = scenario.num_nodes, scenario.num_slots
        #: x, y and z by code, one after the other; where each begins, to go with the cells
        #: of AUVs and nodes, or of pairs of AUVs.
        self._coordinates = backend.floats(grid.coordinate_table().T.reshape(-1) + 1)
        axes = backend.integers(np.arange(3) * grid.num_codes)
        self._axes = {2: axes[:, None, None], 3: axes[:, None, None, None]}
        self._size = np.array(grid.shape, dtype=np.float64)
        self._last_cell = backend.floats([float(max(n - 1, 1)) for n in grid.shape])
        self._maximum_age = float(scenario.age.maximum)
        # All AUVs at the node, charging it alone through the whole episode.
        best_slot_j = float(link.budget.harvested_power_w(0.0)) * scenario.slot_s
        self._most_j = best_slot_j * scenario.num_slots * scenario.num_auvs

    def positions(self, cell: Array, *, scaled: bool | None = None) -> Array:
        """x, y and z of cells by code, counted from 1: (…, 3)."""
        xp = self._xp
        places = self._axes[cell.ndim] + turned(xp, cell)
        xyz = turned(xp, lookup(xp, self._coordinates, places))
        is_scaled = self.is_scaled if scaled is None else scaled
        return (xyz - 1) / self._last_cell if is_scaled else xyz

    def position_ranges(self) -> Ranges:
        """Of one cell."""
        ones = np.ones(3)
        if self.is_scaled:
            return Ranges(0 * ones, ones, ones)
        return Ranges(ones, self._size, self._size)

    def steps(self, steps: Array) -> Array:
        """Differences of positions in cells, (…, 3)."""
        return steps / self._last_cell if self.is_scaled else steps

    def step_ranges(self) -> Ranges:
        """Of one difference."""
        far = np.ones(3) if self.is_scaled else np.maximum(self._size - 1, 1)
        return Ranges(-far, far, far)

    def ages(self, age: Array) -> Array:
        """Ages in slots."""
        return age / self._maximum_age if self.is_scaled else age

    def age_ranges(self) -> Ranges:
        """Of one age for each node."""
        if self.is_scaled:
            return Ranges.alike(self._num_nodes, 0, 1, 1)
        return Ranges.alike(self._num_nodes, 1, self._maximum_age, self._maximum_age)

    def energies(self, energy_j: Array) -> Array:
        """Stored energies in J."""
        return energy_j / (energy_j + self.price_j) if self.is_scaled else energy_j

    def energy_ranges(self) -> Ranges:
        """Of one energy for each node."""
        if self.is_scaled:
            return Ranges.alike(self._num_nodes, 0, 1, 1)
        return Ranges.alike(self._num_nodes, 0, self._most_j, self.price_j)

    def counts(self, deliveries: Array) -> Array:
        """Numbers of deliveries; scaled, per slot."""
        return deliveries / self._num_slots if self.is_scaled else deliveries

    def count_ranges(self) -> Ranges:
        """Of one number for each node; K nodes share the deliveries."""
        k, slots = self._num_nodes, self._num_slots
        if self.is_scaled:
            return Ranges.alike(k, 0, 1, 1 / k)
        return Ranges.alike(k, 0, slots, slots / k)

    def durations(self, slots: Array) -> Array:
        """Numbers of slots; scaled, shares of the episode."""
        return slots / self._num_slots if self.is_scaled else slots

    def duration_ranges(self) -> Ranges:
        """Of one duration for each node."""
        longest = 1.0 if self.is_scaled else float(self._num_slots)
        return Ranges.alike(self._num_nodes, 0, longest, longest)

    def time(self, slot: Array) -> Array:
        """The share of the episode that is over: (envs,) slots to (envs, 1)."""
        return self._xp.astype(slot, self._dtype)[:, None] / self._num_slots


def _price_j(scenario: Scenario, link: Link) -> float:
    """Energy of an uplink over half the grid's diagonal: the yardstick for stored energy."""
    half_diagonal = 0.5 * scenario.grid.spacing_m * np.linalg.norm(scenario.grid.cells)
    power_per_snr_w = link.budget.power_per_snr_w(min(float(half_diagonal), FARTHEST_M))
    price_j = unheard(link.budget.required_energy_j)(power_per_snr_w, link.slot_s)
    # Divisors must be no less than numbers are, nor more.
    return float(bounded(price_j, *UPLINK_W))
