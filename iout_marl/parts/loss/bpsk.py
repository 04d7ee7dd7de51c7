"""Packets that bit errors destroy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from iout_marl.core.grid import Floats
from iout_marl.parts.loss.base import Loss, losses
from iout_marl.physics.packets import bpsk_bit_error_rate, packet_error_rate

if TYPE_CHECKING:
    from iout_marl.parts.uplink.base import Uplink


@losses.register("bpsk")
class Bpsk(Loss):
    """Bit errors of coherent binary phase shifts, without a code: one destroys the packet.

    E_b/N₀ = SNR · B/R, P_b = ½ erfc √(E_b/N₀), PER = 1 − (1 − P_b)^L.
    """

    loses = True

    def packet_error_rate(self, snr_db: Floats, uplink: Uplink) -> Floats:
        bits_per_hertz = uplink.settings.bit_rate_bps / uplink.bandwidth_hz
        wrong = bpsk_bit_error_rate(snr_db - 10 * np.log10(bits_per_hertz))
        return packet_error_rate(uplink.packet_bits, wrong)
