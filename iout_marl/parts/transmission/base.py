"""Transmission: by what rule sound loses its level between an AUV and a node."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from iout_marl.core.grid import Floats, Grid
from iout_marl.core.pairs import Pairs
from iout_marl.parts.base import Part
from iout_marl.physics.arrays import Array, ArrayLike
from iout_marl.registry import Registry
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import invalid

if TYPE_CHECKING:
    from iout_marl.parts.channel.base import Channel


class Transmission(Part):
    """Transmission loss: by the distance alone, or for each of some pairs of cells.

    A kind has either `attenuation_db`, or both `pairs` and `loss_db`.
    """

    def attenuation_db(
        self, distance_m: ArrayLike, frequency_khz: float, channel: Channel
    ) -> Array:
        """Loss between source and receiver in dB, in the shape of `distance_m`.

        Args:
            distance_m: how far apart they are.
            frequency_khz: of the sound.
            channel: of which it is a part.
        """
        raise NotImplementedError

    def pairs(self, grid: Grid) -> Pairs | None:  # noqa: ARG002
        """The pairs of cells that it tells apart; None where the distance says all."""
        return None

    def loss_db(self, scenario: Scenario, pairs: Pairs, frequency_khz: float) -> Floats:
        """Loss between the cells of each pair in dB, either way, (pairs,)."""
        raise NotImplementedError

    def check_stated(self, scenario: Scenario) -> None:
        pairs = self.pairs(Grid.from_scenario(scenario))
        if pairs is None:
            return
        if not isinstance(pairs, Pairs):
            raise self.fault(f"pairs must be Pairs or None, not {type(pairs).__name__}")
        khz = scenario.duplex.part.uplink_frequency_khz
        found = np.asarray(self.loss_db(scenario, pairs, khz))
        if found.shape != pairs.way_m.shape or found.dtype.kind not in "fiu":
            raise self.fault(
                f"loss_db must be a number for each of {len(pairs.way_m)} pairs, not "
                f"{found.dtype} of shape {found.shape}"
            )
        if not np.isfinite(found).all():
            raise self.fault(f"loss_db is not finite at {khz:g} kHz")


transmissions: Registry[type[Transmission]] = Registry("transmission", Transmission)


def refuse(message: str, *, key: str = "tables", beside: tuple[str, ...] = ()) -> Exception:
    """What is raised of a setting of a transmission that does not fit its scenario."""
    return invalid(("channel", "transmission", key), message, beside=beside)
