"""Hydrophones with a matched load."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from iout_marl import physics
from iout_marl.parts.harvester.base import Harvester, harvesters
from iout_marl.physics.arrays import Array, ArrayLike, as_arrays
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import (
    Area,
    Count,
    Decibels,
    Efficiency,
    Plausible,
    Positive,
)
from iout_marl.scenario.parts import Settings as PartSettings


@harvesters.register("hydrophone")
class Hydrophone(Harvester):
    """Hydrophones whose voltage drives a matched load, as the paper has them.

    This says nothing of how much sound passes them: with an `area_m2`, which takes a channel of
    consistent units, no more is harvested than passes that area, nor than the source emits.
    """

    class Settings(PartSettings):
        #: Receiving voltage sensitivity of a hydrophone.
        sensitivity_db: Annotated[Decibels, Plausible(-260, -100, "dB re 1 V/µPa", slips=(-1, 10))]
        #: Share of the power of the hydrophones that is stored.
        efficiency: Efficiency
        #: Hydrophones of a node, whose powers add up.
        hydrophones: Annotated[Count, Field(le=10**6), Plausible(1, 1000, "hydrophones")]
        #: Resistance of the load that takes the power.
        load_resistance_ohm: Annotated[Positive, Plausible(0.01, 1e9, "Ω")]
        #: Area through which all hydrophones together take sound (`channel.kind: sonar`): at most
        #: what passes it, and what the source emits, times the efficiency is harvested; null for
        #: no such limit.
        area_m2: Area | None = None

        hash_defaults: ClassVar[dict[str, Any]] = {"kind": "hydrophone", "area_m2": None}

    settings: Settings

    def check(self, scenario: Scenario) -> None:
        if self.settings.area_m2 is not None:
            scenario.channel.part.need_physical_levels(
                ("harvester", "area_m2"), "what passes an area follows from"
            )

    def harvested_power_w(self, received_level_db: ArrayLike, acoustic_power_w: float) -> Array:
        own = self.settings
        into_load_w = physics.harvested_power_w.unchecked(
            received_level_db,
            own.sensitivity_db,
            own.load_resistance_ohm,
            own.efficiency,
            own.hydrophones,
        )
        if own.area_m2 is None:
            return into_load_w
        passing_w = physics.aperture_power_w.unchecked(
            received_level_db, own.area_m2, acoustic_power_w, own.efficiency
        )
        xp, into_load_w, passing_w = as_arrays(into_load_w, passing_w)
        return xp.minimum(into_load_w, passing_w)

    def harvest_db(self) -> dict[str, float]:
        return {
            "harvester.sensitivity_db": self.settings.sensitivity_db,
            "harvester.load_resistance_ohm": -10
            * float(np.log10(self.settings.load_resistance_ohm)),
        }

    def doubt(self, scenario: Scenario) -> str:
        if self.settings.area_m2 is not None or not scenario.channel.part.has_physical_levels:
            return ""
        return (
            "harvester.area_m2 is not given: hydrophones without one may harvest more than passes "
            "them, and more than the source emits; kind aperture never does"
        )
