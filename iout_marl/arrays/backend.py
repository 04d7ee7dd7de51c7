"""What the arrays of a world are made of: library, floating type, device."""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType
from typing import Any

import array_api_compat
import numpy as np

from iout_marl.physics.arrays import Array, reverse_axes


@dataclass(frozen=True)
class Backend:
    """An array library with the floating type and the device that a world uses.

    Attributes:
        xp: namespace of the array API standard.
        dtype: floating type of ages, energies and rewards.
        device: device of the library, or None for its default.
    """

    xp: Any
    dtype: Any
    device: Any = None

    @classmethod
    def from_library(cls, library: Any = np, dtype: str = "float64", device: Any = None) -> Backend:
        """A backend from a library such as `numpy` or `torch`, or any namespace of the standard."""
        # NumPy 2 follows the standard by itself: without the wrapper, steps cost less.
        xp = library
        if isinstance(library, ModuleType) and library is not np:
            xp = array_api_compat.array_namespace(library.asarray([0.0]))
        return cls(xp, getattr(xp, dtype), device)

    def floats(self, values: Any) -> Array:
        """`values` as a floating array."""
        return self.xp.asarray(values, dtype=self.dtype, device=self.device)

    def integers(self, values: Any) -> Array:
        """`values` as an integer array, fit for indexing."""
        return self.xp.asarray(values, dtype=self.xp.int64, device=self.device)

    def surely_none(self, flags: Array) -> bool:
        """Whether all flags are false, as far as asking costs nothing.

        An accelerator would have to stop for the answer, and a compiled graph would break:
        there it is False, and a loop that could end early continues without effect.
        """
        return self.xp is np and not flags.any()

    def zeros(self, shape: tuple[int, ...]) -> Array:
        """Floating zeros, laid out by `with_envs_inside`."""
        zeros = self.xp.zeros(shape[::-1], dtype=self.dtype, device=self.device)
        return reverse_axes(self.xp, zeros)

    def with_envs_inside(self, values: Array) -> Array:
        """`values` laid out in memory with the environments next to one another.

        Shapes begin with the environments, but their axis is the longest: whatever is done
        to every element, or over nodes, runs along it. Nothing but speed depends on it.
        """
        inside = reverse_axes(self.xp, values)
        return reverse_axes(self.xp, self.xp.reshape(self.xp.reshape(inside, (-1,)), inside.shape))
