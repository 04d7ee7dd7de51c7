"""Absorption by frequency alone."""

from __future__ import annotations

from iout_marl import physics
from iout_marl.parts.absorption.base import Absorption, absorptions
from iout_marl.physics.arrays import Array, ArrayLike


@absorptions.register("thorp")
class Thorp(Absorption):
    """Thorp's formula, for 4 °C and about 1 km of depth."""

    def db_per_km(self, frequency_khz: ArrayLike) -> Array:
        return physics.thorp_absorption_db_per_km.unchecked(frequency_khz)
