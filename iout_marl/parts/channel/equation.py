"""The channel of the paper's equation."""

from __future__ import annotations

from iout_marl import physics
from iout_marl.parts.channel.base import channels
from iout_marl.parts.channel.levels import Levels
from iout_marl.physics.arrays import Array, ArrayLike


@channels.register("equation")
class Equation(Levels):
    """Levels as the paper computes them, attenuated by 10 k_s log₁₀ d + α d, its eq. `AL`."""

    def attenuation_db(self, distance_m: ArrayLike, frequency_khz: float) -> Array:
        return physics.transmission_loss_db.unchecked(
            distance_m, self.alpha_db_per_km(frequency_khz), self.settings.spreading_factor
        )
