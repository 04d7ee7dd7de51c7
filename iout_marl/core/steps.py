"""Functions of one number as tables on evenly spaced values: the same on every array library."""

from __future__ import annotations

import numpy.typing as npt

from iout_marl.arrays.backend import Backend
from iout_marl.physics.arrays import Array, cast, lookup_inside


class Steps:
    """A function at multiples of a step, held beyond both ends.

    Args:
        backend: arrays to work with.
        values: (entries,) of the function, at (first + i) · step.
        first: the first multiple.
        per_unit: one over the step.
        nearest: whether a number counts as the nearest multiple; if not, as the one below.
    """

    def __init__(
        self, backend: Backend, values: npt.ArrayLike, first: int, per_unit: int, *, nearest: bool
    ) -> None:
        self._xp = backend.xp
        self._table = backend.floats(values)
        self._per_unit = backend.floats(float(per_unit))
        self._shift = backend.floats(0.5 * nearest - first)
        self._none, self._last = (backend.floats(float(i)) for i in (0, len(self._table) - 1))

    def at(self, numbers: Array) -> Array:
        """The function at numbers, in their shape."""
        xp = self._xp
        place = xp.maximum(numbers * self._per_unit + self._shift, self._none)
        # Whole numbers below the place: none of them is negative.
        index = cast(xp, xp.minimum(place, self._last), xp.int64)
        return lookup_inside(xp, self._table, index)
