"""Packets of an acoustic modem."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

from pydantic import Field

from iout_marl import physics
from iout_marl.parts.channel import Channel
from iout_marl.parts.loss import Loss
from iout_marl.parts.uplink.base import Uplink, uplinks
from iout_marl.physics.arrays import Array, ArrayLike, as_arrays
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import (
    Bandwidth,
    NonNegative,
    PacketBits,
    Plausible,
    Positive,
    invalid,
)
from iout_marl.scenario.parts import PartOf
from iout_marl.scenario.parts import Settings as PartSettings


@uplinks.register("modem")
class Modem(Uplink):
    """An acoustic modem, which sends at its bit rate, as loud as it has to and can.

    It sends for the airtime L/R, and its electronics draw meanwhile: a packet takes
    (`electronics_w` + transmit power) · L/R. Call and answer take 2 d/c more. The source level is
    NL + TL + SNR; where that would exceed the maximum, nothing is sent. Where `channel.access`
    divides the band, the bit rate is divided alike. It takes a channel of consistent units, such
    as `sonar`, whose transmitter it has, and in time division `duplex.beta_rule: airtime`.
    """

    class Settings(PartSettings):
        #: Bits sent a second, in the whole band.
        bit_rate_bps: Annotated[Positive, Plausible(1, 1e6, "bit/s")]
        #: Size of a packet, headers and code included.
        packet_bits: PacketBits
        #: Width of the band, which AUVs share as `channel.access` says.
        bandwidth_hz: Bandwidth
        #: What the electronics draw while the modem sends, its transmitter aside.
        electronics_w: Annotated[NonNegative, Plausible(0, 100, "W")]
        #: The loudest that it can send.
        maximum_source_level_db: Annotated[
            float, Field(ge=0, le=300), Plausible(100, 220, "dB re 1 µPa at 1 m")
        ]
        #: Signal over noise in the band with which packets arrive.
        required_snr_db: Annotated[float, Field(ge=-100, le=100), Plausible(-30, 40, "dB")] = 10.0
        #: Whether it sends just as loud as the distance needs; if not, always at its loudest.
        power_control: bool = True
        #: By how much louder it sends than that, where it can, against what it does not know of:
        #: shadowing and wind.
        margin_db: Annotated[float, Field(ge=0, le=100), Plausible(0, 40, "dB")] = 0.0
        #: Which packets get lost by what they arrive with.
        loss: Annotated[PartSettings, PartOf("loss", is_word=True)] = Field(
            "none", validate_default=True
        )

        hash_defaults: ClassVar[dict[str, Any]] = {"margin_db": 0.0, "loss": "none"}

    settings: Settings

    def check(self, scenario: Scenario) -> None:
        channel, duplex = scenario.channel.part, scenario.duplex.part
        channel.need_physical_levels(("uplink", "kind"), "'modem' takes")
        super().check(scenario)
        bands = channel.access.num_bands(scenario.num_auvs)
        airtime_s, longest_s = self._airtime_s(bands), scenario.slot_s * duplex.longest_uplink
        if airtime_s > longest_s:
            raise invalid(
                ("uplink", "bit_rate_bps"),
                f"a packet takes {airtime_s:.3g} s, but there are at most {longest_s:.3g} s in a "
                "slot for it: nothing could ever be delivered",
                beside=("uplink", "packet_bits"),
            )

    def _airtime_s(self, num_bands: int) -> float:
        rate_bps = self.settings.bit_rate_bps / num_bands
        return float(physics.airtime_s.unchecked(self.packet_bits, rate_bps))

    def least_time_s(self, distance_m: ArrayLike, num_bands: int) -> Array:
        return self._airtime_s(num_bands) + physics.round_trip_s.unchecked(distance_m)

    def required_energy_j(
        self,
        power_per_snr_w: ArrayLike,
        distance_m: ArrayLike,
        uplink_s: ArrayLike,
        channel: Channel,
        num_bands: int,
    ) -> Array:
        own = self.settings
        loudest_w = self._loudest_w(channel)
        xp, needed_w, takes_s, there_are_s = as_arrays(
            10 ** (own.required_snr_db / 10) * power_per_snr_w,
            self.least_time_s(distance_m, num_bands),
            uplink_s,
        )
        transmit_w = xp.zeros_like(needed_w) + loudest_w
        if own.power_control:
            transmit_w = xp.minimum(needed_w * 10 ** (own.margin_db / 10), transmit_w)
        energy_j = physics.modem_energy_j.unchecked(
            transmit_w, own.electronics_w, self.packet_bits, own.bit_rate_bps / num_bands
        )
        arrives = (needed_w <= loudest_w) & (takes_s <= there_are_s)
        return xp.where(arrives, energy_j, xp.zeros_like(energy_j) + float("inf"))

    def _loudest_w(self, channel: Channel) -> float:
        # The level of an omnidirectional source of so much acoustic power, and the other way round.
        loudest_db = self.settings.maximum_source_level_db
        return channel.as_uplink_w(10 ** ((loudest_db - physics.REFERENCE_LEVEL_DB) / 10))

    @property
    def loss(self) -> Loss:
        loss: Loss = self.settings.loss.part
        return loss

    @property
    def required_snr_db(self) -> float:
        return self.settings.required_snr_db

    def excess_db(self, power_per_snr_w: ArrayLike, channel: Channel) -> Array:
        own = self.settings
        xp, needed_w = as_arrays(10 ** (own.required_snr_db / 10) * power_per_snr_w)
        room_db = 10 * xp.log10(self._loudest_w(channel) / needed_w)
        if not own.power_control:
            return room_db
        return xp.minimum(room_db, xp.zeros_like(room_db) + own.margin_db)
