"""A number that wanders around 0 and forgets what it was: the Gauss-Markov process."""

from __future__ import annotations

import math

from iout_marl.arrays.backend import Backend
from iout_marl.physics.arrays import Array


class Wandering:
    """x_t = ρ x_{t−1} + √(1 − ρ²) σ n_t with ρ = e^(−τ/T), and x = σ n in the first slot.

    So it is as spread in every slot, and its autocorrelation is e^(−t/T): the process that
    decays exponentially, taken at the slots without an error.

    Args:
        backend: arrays to work with.
        sigma: standard deviation σ.
        coherence_s: T in s.
        slot_s: τ in s.
        most: where it is cut off on both sides; None for nowhere.
    """

    def __init__(
        self,
        backend: Backend,
        sigma: float,
        coherence_s: float,
        slot_s: float,
        most: float | None = None,
    ) -> None:
        self._xp = backend.xp
        rho = math.exp(-slot_s / coherence_s)
        self._keeps = backend.floats(rho)
        self._anew = backend.floats(sigma * math.sqrt(-math.expm1(-2 * slot_s / coherence_s)))
        self._at_first = backend.floats(sigma)
        self._none_over = backend.integers(0)
        self._limits = None if most is None else (backend.floats(-most), backend.floats(most))

    def first(self, normal: Array) -> Array:
        """The numbers of the first slot, in the shape of `normal`, what is drawn for it."""
        return self._cut(self._at_first * normal)

    def following(self, before: Array, normal: Array) -> Array:
        """The numbers of a later slot, from those of the slot before and what is drawn for it."""
        return self._cut(self._keeps * before + self._anew * normal)

    def after(self, before: Array, normal: Array, slots_over: Array) -> Array:
        """The numbers of any slot.

        Args:
            before: (envs, …) those of the slot before; 0 in the first one.
            normal: (envs, …) what is drawn.
            slots_over: (envs,) int.
        """
        is_first = (slots_over == self._none_over)[(..., *(None,) * (normal.ndim - 1))]
        new = self._xp.where(is_first, self._at_first, self._anew)
        return self._cut(self._keeps * before + new * normal)

    def _cut(self, numbers: Array) -> Array:
        if self._limits is None:
            return numbers
        low, high = self._limits
        return self._xp.minimum(self._xp.maximum(numbers, low), high)
