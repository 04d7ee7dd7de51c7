"""A current that comes and goes with the tide."""

from typing import Annotated

import numpy as np
from pydantic import Field

from iout_marl.core.current import Frames
from iout_marl.core.grid import Grid
from iout_marl.parts.current.base import (
    Current,
    Direction,
    Period,
    Speed,
    currents,
    middles_s,
    toward,
)
from iout_marl.scenario import Scenario
from iout_marl.scenario.parts import Settings as PartSettings

#: Of the principal lunar tide M2.
M2_H = 12.42


@currents.register("tide")
class Tide(Current):
    """A current that is the same everywhere and turns with the tide, c(t) = c₀ cos(2πt/T + φ)."""

    class Settings(PartSettings):
        #: c₀, the highest speed of the water.
        speed_m_per_s: Speed
        #: Direction that it flows to where the cosine is above 0, clockwise from the grid's +y.
        toward_deg: Direction
        #: T, 12.42 h for the principal lunar tide.
        period_h: Period = M2_H
        #: φ, of the tide when an episode begins: at 0 it is strongest, at 90 about to turn.
        phase_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0

    settings: Settings

    def frames(self, scenario: Scenario) -> Frames:
        velocity = toward(self.settings.speed_m_per_s, self.settings.toward_deg)
        field = np.tile(velocity, (Grid.from_scenario(scenario).num_cells, 1))
        turns = middles_s(scenario) / (3600 * self.settings.period_h)
        cosine = np.cos(2 * np.pi * turns + np.radians(self.settings.phase_deg))
        # Between the field and its opposite: c₀ (1 − 2w) is c₀ cos where w is (1 − cos) / 2.
        weight = (1 - cosine) / 2
        return Frames(np.stack([field, -field]), np.zeros(len(weight), dtype=np.int64), weight)
