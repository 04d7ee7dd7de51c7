"""A receiver of a known aperture."""

from __future__ import annotations

from typing import Annotated

from iout_marl import physics
from iout_marl.parts.harvester.base import Harvester, harvesters
from iout_marl.physics.arrays import Array, ArrayLike
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import Area, Efficiency, NonNegative, Plausible
from iout_marl.scenario.parts import Settings as PartSettings


@harvesters.register("aperture")
class Aperture(Harvester):
    """What passes an aperture, at most what the source emits, times an efficiency.

    It takes a channel of consistent units, such as `sonar`.
    """

    class Settings(PartSettings):
        #: Area through which a node takes sound.
        area_m2: Area
        #: Share of the sound that passes the aperture that is stored.
        efficiency: Efficiency
        #: Sound through the aperture from which on the rectifier works: below it nothing is stored.
        threshold_w: Annotated[NonNegative, Plausible(0, 100, "W")] = 0.0

    settings: Settings

    def check(self, scenario: Scenario) -> None:
        scenario.channel.part.need_physical_levels(("harvester", "kind"), "'aperture' takes")

    def harvested_power_w(self, received_level_db: ArrayLike, acoustic_power_w: float) -> Array:
        own = self.settings
        return physics.aperture_power_w.unchecked(
            received_level_db, own.area_m2, acoustic_power_w, own.efficiency, own.threshold_w
        )
