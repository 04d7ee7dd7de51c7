"""Channels of levels as the paper has them: one noise level, acoustic power alone."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from iout_marl import physics
from iout_marl.parts.channel.base import Channel, Shared
from iout_marl.physics.arrays import Array, ArrayLike
from iout_marl.scenario.fields import Decibels, Plausible, Spreading
from iout_marl.scenario.parts import PartOf
from iout_marl.scenario.parts import Settings as PartSettings


class Levels(Channel):
    """Levels as the paper computes them, but for the attenuation, which kinds differ in."""

    class Settings(PartSettings, Shared):
        #: k_s: 1 for cylindrical spreading, 2 for spherical.
        spreading_factor: Spreading = 1.5
        #: Noise level NL, subtracted from the energy signal too.
        noise_level_db: Annotated[Decibels, Plausible(-20, 200, "dB re 1 µPa")] = 30.0
        #: What the water itself takes of the sound.
        absorption: Annotated[PartSettings, PartOf("absorption")] = Field(
            {"kind": "thorp"}, validate_default=True
        )

    settings: Settings

    @property
    def charging_noise_db(self) -> float:
        # The paper subtracts the noise from the energy signal; real noise adds power.
        return self.settings.noise_level_db

    def power_per_snr_w(
        self,
        distance_m: ArrayLike,
        frequency_khz: float,
        bandwidth_hz: float,  # noqa: ARG002
    ) -> Array:
        loss = self.attenuation_db(distance_m, frequency_khz)
        return physics.transmit_power_w.unchecked(1.0, loss, self.settings.noise_level_db)

    def as_uplink_w(self, acoustic_w: float) -> float:
        return acoustic_w

    def harvest_db(self) -> dict[str, float]:
        return {"channel.noise_level_db": -self.settings.noise_level_db}
