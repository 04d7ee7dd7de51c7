"""Observations in numbers of order one."""

from __future__ import annotations

import numpy as np

from iout_marl.core.ranges import Ranges
from iout_marl.parts.base import Context
from iout_marl.parts.observation.base import Representation, representations
from iout_marl.physics.arrays import Array


@representations.register("scaled")
class Scaled(Representation):
    """All in [0, 1], energies by e/(e + the energy of an uplink over half the grid)."""

    def setup(self, world: Context) -> None:
        super().setup(world)
        self._last_cell = world.backend.floats([float(max(n - 1, 1)) for n in world.grid.shape])

    def positions(self, cell: Array) -> Array:
        return (self.in_cells(cell) - 1) / self._last_cell

    def position_ranges(self) -> Ranges:
        return Ranges.uniform(3, 0, 1, 1)

    def steps(self, steps: Array) -> Array:
        return steps / self._last_cell

    def step_ranges(self) -> Ranges:
        ones = np.ones(3)
        return Ranges(-ones, ones, ones)

    def ages(self, age: Array) -> Array:
        return age / self._maximum_age

    def age_ranges(self) -> Ranges:
        return Ranges.uniform(self._num_nodes, 0, 1, 1)

    def energies(self, energy_j: Array) -> Array:
        return energy_j / (energy_j + self.reference_energy_j)

    def energy_ranges(self) -> Ranges:
        return Ranges.uniform(self._num_nodes, 0, 1, 1)

    def counts(self, deliveries: Array) -> Array:
        """Deliveries per slot."""
        return deliveries / self._num_slots

    def count_ranges(self) -> Ranges:
        return Ranges.uniform(self._num_nodes, 0, 1, 1 / self._num_nodes)

    def durations(self, slots: Array) -> Array:
        """Shares of the episode."""
        return slots / self._num_slots

    def duration_ranges(self) -> Ranges:
        return Ranges.uniform(self._num_nodes, 0, 1, 1)

    def waits(self, slots: Array, most_slots: int) -> Array:
        """Shares of the most."""
        return slots / most_slots

    def wait_ranges(self, count: int, most_slots: int) -> Ranges:  # noqa: ARG002
        return Ranges.uniform(count, 0, 1, 1)
