"""Absorption by frequency, temperature, salinity, depth and acidity."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from iout_marl import physics
from iout_marl.parts.absorption.base import Absorption, absorptions
from iout_marl.physics.arrays import Array, ArrayLike
from iout_marl.scenario.parts import Settings as PartSettings


@absorptions.register("francois_garrison")
class FrancoisGarrison(Absorption):
    """The formula of Francois and Garrison (1982)."""

    class Settings(PartSettings):
        #: Temperature of the water.
        temperature_c: Annotated[float, Field(ge=-2, le=40)] = 10.0
        #: Salinity of the water.
        salinity_psu: Annotated[float, Field(gt=0, le=50)] = 35.0
        #: Depth at which the absorption is taken.
        depth_m: Annotated[float, Field(ge=0, le=11000)] = 200.0
        #: Acidity of the water.
        ph: Annotated[float, Field(ge=6, le=9)] = 8.0

    settings: Settings

    def db_per_km(self, frequency_khz: ArrayLike) -> Array:
        sea = self.settings
        return physics.francois_garrison_absorption_db_per_km.unchecked(
            frequency_khz, sea.temperature_c, sea.salinity_psu, sea.depth_m, sea.ph
        )
