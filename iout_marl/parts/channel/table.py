"""The channel behind the paper's tables."""

from __future__ import annotations

from iout_marl import physics
from iout_marl.parts.channel.base import channels
from iout_marl.parts.channel.levels import Levels
from iout_marl.physics.arrays import Array, ArrayLike


@channels.register("table")
class Table(Levels):
    """Levels as the paper computes them, attenuated by k_s log₁₀ d + α d.

    This form is behind the paper's tables and results.
    """

    def attenuation_db(self, distance_m: ArrayLike, frequency_khz: float) -> Array:
        return physics.table_attenuation_db.unchecked(
            distance_m, self.alpha_db_per_km(frequency_khz), self.settings.spreading_factor
        )
