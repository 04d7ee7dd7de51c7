"""Packets at Shannon's rate."""

from __future__ import annotations

from typing import Any, ClassVar

from iout_marl import physics
from iout_marl.parts.channel import Channel
from iout_marl.parts.uplink.base import Uplink, uplinks
from iout_marl.physics.arrays import Array, ArrayLike
from iout_marl.scenario.fields import Bandwidth, PacketBits
from iout_marl.scenario.parts import Settings as PartSettings


@uplinks.register("shannon")
class Shannon(Uplink):
    """Packets at Shannon's rate in all the time that there is, whose sound is all they cost."""

    class Settings(PartSettings):
        #: Size of a packet.
        packet_bits: PacketBits
        #: Width of the band, which AUVs share as `channel.access` says.
        bandwidth_hz: Bandwidth

        hash_defaults: ClassVar[dict[str, Any]] = {"kind": "shannon"}

    settings: Settings
    fills_its_time = True

    def required_energy_j(
        self,
        power_per_snr_w: ArrayLike,
        distance_m: ArrayLike,  # noqa: ARG002
        uplink_s: ArrayLike,
        channel: Channel,  # noqa: ARG002
        num_bands: int,
    ) -> Array:
        hertz = self.bandwidth_hz / num_bands
        snr = physics.required_snr.unchecked(self.packet_bits, uplink_s, hertz)
        return physics.required_energy_j.unchecked(snr * power_per_snr_w, uplink_s)
