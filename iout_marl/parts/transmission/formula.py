"""Transmission loss by spreading and absorption."""

from __future__ import annotations

from iout_marl import physics
from iout_marl.parts.channel.base import Channel
from iout_marl.parts.transmission.base import Transmission, transmissions
from iout_marl.physics.arrays import Array, ArrayLike


@transmissions.register("formula")
class Formula(Transmission):
    """10 k_s log₁₀ d + α d, by the channel's `spreading_factor` and `absorption`."""

    def attenuation_db(
        self, distance_m: ArrayLike, frequency_khz: float, channel: Channel
    ) -> Array:
        return physics.transmission_loss_db.unchecked(
            distance_m,
            channel.alpha_db_per_km(frequency_khz),
            channel.settings.spreading_factor,
        )
