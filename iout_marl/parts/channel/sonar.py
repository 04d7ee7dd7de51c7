"""The channel of the sonar equation."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from iout_marl import physics
from iout_marl.core.grid import Grid
from iout_marl.core.limits import UPLINK_W, bounded
from iout_marl.core.pairs import Pairs
from iout_marl.parts.channel.base import Channel, Shared, channels
from iout_marl.parts.transmission import Transmission
from iout_marl.physics.arrays import Array, ArrayLike
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import (
    Directivity,
    Efficiency,
    Fraction,
    NonNegative,
    Plausible,
    Spreading,
    invalid,
)
from iout_marl.scenario.parts import PartOf
from iout_marl.scenario.parts import Settings as PartSettings


@channels.register("sonar")
class Sonar(Channel):
    """Consistent units: the sonar equation, ambient noise in the uplink's band."""

    class Settings(PartSettings, Shared):
        #: k_s: 1 for cylindrical spreading, 2 for spherical.
        spreading_factor: Spreading = 1.5
        #: What the water itself takes of the sound.
        absorption: Annotated[PartSettings, PartOf("absorption")] = Field(
            {"kind": "thorp"}, validate_default=True
        )
        #: Shipping activity of Wenz's noise, from 0 to 1.
        shipping: Fraction = 0.5
        #: Wind speed of Wenz's noise; its mean, where `wind` changes it. Nodes set the power of
        #: their uplinks by it.
        wind_m_per_s: Annotated[NonNegative, Field(le=1000), Plausible(0, 100, "m/s")] = 0.0
        #: Electro-acoustic efficiency of a node's transmitter.
        uplink_efficiency: Efficiency = 0.5
        #: Directivity index of a node's transmitter.
        uplink_directivity_index_db: Directivity = 0.0
        #: By what rule sound loses its level; tables take the place of `spreading_factor` and
        #: `absorption`.
        transmission: Annotated[PartSettings, PartOf("transmission", is_word=True)] = Field(
            "formula", validate_default=True
        )

        #: By what the levels of links change from slot to slot, of charging and of uplinks.
        fading: Annotated[PartSettings, PartOf("fading", is_word=True)] = Field(
            "none", validate_default=True
        )
        #: How the wind changes, whose noise packets get lost in (`uplink.loss`).
        wind: Annotated[PartSettings, PartOf("wind", is_word=True)] = Field(
            "steady", validate_default=True
        )

        hash_defaults: ClassVar[dict[str, Any]] = {
            **Shared.hash_defaults,
            "transmission": "formula",
            "fading": "none",
            "wind": "steady",
        }

    settings: Settings
    has_physical_levels = True

    @property
    def _transmission(self) -> Transmission:
        transmission: Transmission = self.settings.transmission.part
        return transmission

    def check(self, scenario: Scenario) -> None:
        super().check(scenario)
        self._transmission.check(scenario)
        duplex = scenario.duplex.part
        frequency_khz: float = duplex.uplink_frequency_khz
        if scenario.uplink.part.bandwidth_hz >= 2e3 * frequency_khz:
            raise invalid(
                ("uplink", "bandwidth_hz"),
                f"the band around {frequency_khz:g} kHz must stay above 0 Hz",
                beside=("duplex", duplex.uplink_frequency_key),
            )

    def attenuation_db(self, distance_m: ArrayLike, frequency_khz: float) -> Array:
        return self._transmission.attenuation_db(distance_m, frequency_khz, self)

    def pairs(self, grid: Grid) -> Pairs | None:
        return self._transmission.pairs(grid)

    def pair_loss_db(self, scenario: Scenario, pairs: Pairs, frequency_khz: float) -> Array:
        return self._transmission.loss_db(scenario, pairs, frequency_khz)

    def power_per_snr_w(
        self, distance_m: ArrayLike, frequency_khz: float, bandwidth_hz: float
    ) -> Array:
        loss_db = self.attenuation_db(distance_m, frequency_khz)
        return self.power_per_snr_after_loss_w(loss_db, frequency_khz, bandwidth_hz)

    def power_per_snr_after_loss_w(
        self, loss_db: ArrayLike, frequency_khz: float, bandwidth_hz: float
    ) -> Array:
        sea = self.settings
        noise = physics.ambient_noise_band_level_db.unchecked(
            frequency_khz, bandwidth_hz, sea.shipping, sea.wind_m_per_s
        )
        return physics.sonar_transmit_power_w.unchecked(
            1.0, loss_db, noise, sea.uplink_efficiency, sea.uplink_directivity_index_db
        )

    def noise_above_mean_db(
        self, wind_m_per_s: ArrayLike, frequency_khz: float, bandwidth_hz: float
    ) -> Array:
        sea = self.settings
        now, mean = (
            physics.ambient_noise_band_level_db.unchecked(
                frequency_khz, bandwidth_hz, sea.shipping, wind
            )
            for wind in (wind_m_per_s, sea.wind_m_per_s)
        )
        return now - mean

    def as_uplink_w(self, acoustic_w: float) -> float:
        # Uplinks are in electric power, through a projector of their own.
        gain = np.float64(10) ** (self.settings.uplink_directivity_index_db / 10)
        return float(
            bounded(acoustic_w / (self.settings.uplink_efficiency * gain), 0.0, UPLINK_W[1])
        )
