"""Harvester: what a node stores of the sound that reaches it."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from iout_marl.parts.base import Part
from iout_marl.physics.arrays import Array, ArrayLike
from iout_marl.registry import Registry
from iout_marl.scenario import Scenario
from iout_marl.whole import is_number, short


class Harvester(Part):
    """The receiver with which a node harvests.

    Its arguments are not checked: a scenario may say what physics refuses.
    """

    @abstractmethod
    def harvested_power_w(self, received_level_db: ArrayLike, acoustic_power_w: float) -> Array:
        """Power that is stored, in W.

        Args:
            received_level_db: level of the sound that charges, in dB re 1 µPa, of any shape.
            acoustic_power_w: acoustic power of its source, in W.

        Returns:
            power in the shape of the levels, from 0.
        """

    def harvest_db(self) -> dict[str, float]:
        """What keys of the harvester add to what is harvested, in dB."""
        return {}

    def doubt(self, scenario: Scenario) -> str:  # noqa: ARG002
        """Why its energies in a scenario are not to be believed, in one line; empty if they are."""
        return ""

    def check_stated(self, scenario: Scenario) -> None:
        for key, gain_db in self.harvest_db().items():
            if not is_number(gain_db):
                raise self.fault(f"harvest_db() must map keys to numbers, but {key} to {gain_db!r}")
        charging = scenario.charging
        levels = np.array([100.0, 160.0, 220.0])
        with np.errstate(all="ignore"):
            found = self.harvested_power_w(levels, charging.power_w * charging.efficiency)
        if not isinstance(found, np.ndarray) or found.shape != levels.shape:
            raise self.fault(
                f"harvested_power_w must give a number for each of 3 levels, not {short(found)}"
            )
        if not (found.dtype.kind in "fiu" and np.isfinite(found).all() and (found >= 0).all()):
            raise self.fault(f"harvested_power_w must be finite and from 0 W, not {short(found)}")


harvesters: Registry[type[Harvester]] = Registry("harvester", Harvester)
