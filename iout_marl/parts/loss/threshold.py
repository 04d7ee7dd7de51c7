"""Packets that arrive if they are loud enough."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from iout_marl.core.grid import Floats
from iout_marl.parts.loss.base import Loss, losses

if TYPE_CHECKING:
    from iout_marl.parts.uplink.base import Uplink


@losses.register("threshold")
class Threshold(Loss):
    """Packets arrive where their signal is `uplink.required_snr_db` above the noise or more."""

    loses = is_certain = True

    def packet_error_rate(self, snr_db: Floats, uplink: Uplink) -> Floats:
        return np.where(snr_db >= uplink.required_snr_db, 0.0, 1.0)
