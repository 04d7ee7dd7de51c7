"""Loss: which packets that were sent do not arrive."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from iout_marl.core.chance import Draw
from iout_marl.core.grid import Floats
from iout_marl.parts.base import Part
from iout_marl.registry import Registry
from iout_marl.scenario import Scenario
from iout_marl.whole import short

if TYPE_CHECKING:
    from iout_marl.parts.uplink.base import Uplink


class Loss(Part):
    """How many packets get lost at a signal-to-noise ratio.

    It is asked once, for a table, of which a world takes its entries.

    Attributes:
        loses: whether a packet ever gets lost. If not, the part is never called.
        is_certain: whether all packets of a ratio share their fate: nothing is left to chance.
    """

    loses: bool = False
    is_certain: bool = False

    def draws(self, scenario: Scenario) -> dict[str, Draw]:
        if self.is_certain or not self.loses:
            return {}
        packets = 1 + scenario.hearing.part.rounds(scenario.num_nodes)
        return {"arrival": Draw("uniform", (scenario.num_auvs, packets))}

    def packet_error_rate(self, snr_db: Floats, uplink: Uplink) -> Floats:
        """Share of packets that get lost, from 0 to 1, in the shape of the ratios.

        Args:
            snr_db: signal over noise in the band when packets arrive, in dB.
            uplink: whose packets they are.
        """
        raise NotImplementedError

    def check_stated(self, scenario: Scenario) -> None:
        for name in ("loses", "is_certain"):
            if not isinstance(getattr(self, name), bool):
                raise self.fault(f"{name} must be True or False, not {short(getattr(self, name))}")
        if not self.loses:
            return
        ratios = np.array([-100.0, 0.0, 10.0, 100.0])
        with np.errstate(all="ignore"):
            found = np.asarray(self.packet_error_rate(ratios, scenario.uplink.part))
        if found.shape != ratios.shape or found.dtype.kind not in "fiu":
            raise self.fault(f"packet_error_rate must give a number for each ratio, not {found!r}")
        if not ((found >= 0) & (found <= 1)).all():
            raise self.fault(f"packet_error_rate must lie between 0 and 1, not {short(found)}")
        if self.is_certain and not np.isin(found, (0, 1)).all():
            raise self.fault("packet_error_rate must be 0 or 1 where is_certain is True")


losses: Registry[type[Loss]] = Registry("loss", Loss)
