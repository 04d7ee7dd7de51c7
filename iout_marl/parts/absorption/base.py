"""Absorption: what sea water takes of sound along the way."""

from __future__ import annotations

from iout_marl.parts.base import Part
from iout_marl.physics.arrays import Array, ArrayLike
from iout_marl.registry import Registry


class Absorption(Part):
    """A formula for the absorption of sound in sea water."""

    def db_per_km(self, frequency_khz: ArrayLike) -> Array:
        """α(f) in dB/km, in the shape of the frequencies."""
        raise NotImplementedError


absorptions: Registry[type[Absorption]] = Registry("absorption", Absorption)
