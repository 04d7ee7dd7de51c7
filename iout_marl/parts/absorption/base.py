"""Absorption: what sea water takes of sound along the way."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from iout_marl.parts.base import Part
from iout_marl.physics.arrays import Array, ArrayLike
from iout_marl.registry import Registry
from iout_marl.scenario import Scenario
from iout_marl.whole import is_number, short


class Absorption(Part):
    """A formula for the absorption of sound in sea water."""

    @abstractmethod
    def db_per_km(self, frequency_khz: ArrayLike) -> Array:
        """α(f) in dB/km, in the shape of the frequencies."""

    def check_stated(self, scenario: Scenario) -> None:
        khz = scenario.duplex.part.uplink_frequency_khz
        found = self.db_per_km(khz)
        if not (np.ndim(found) == 0 and is_number(float(found), 0)):
            raise self.fault(
                f"db_per_km({khz:g}) must be a number from 0 in dB/km, not {short(found)}"
            )


absorptions: Registry[type[Absorption]] = Registry("absorption", Absorption)
