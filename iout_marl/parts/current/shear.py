"""A current that falls off with depth."""

from typing import Annotated

import numpy as np

from iout_marl.core.current import Frames
from iout_marl.parts.current.base import (
    Current,
    Direction,
    Speed,
    currents,
    positions_m,
    toward,
)
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import Plausible, Positive
from iout_marl.scenario.parts import Settings as PartSettings


@currents.register("shear")
class Shear(Current):
    """A current that is strongest above and falls off with depth, c(z) = c₀ e^(−z/z₀).

    z is the depth of a cell's centre below the surface by `grid.origin.depth_m`; without an origin
    it counts from the centre of the uppermost layer.
    """

    class Settings(PartSettings):
        #: c₀, speed of the water at z = 0.
        speed_m_per_s: Speed
        #: Direction that it flows to, clockwise from the grid's +y.
        toward_deg: Direction
        #: z₀, over which it falls to 37 %.
        depth_scale_m: Annotated[Positive, Plausible(0.1, 1e4, "m")]

    settings: Settings
    reads_origin = True

    def frames(self, scenario: Scenario) -> Frames:
        origin = scenario.grid.origin
        depth_m = positions_m(scenario)[:, 2] + (origin.depth_m if origin else 0.0)
        speed = self.settings.speed_m_per_s * np.exp(-depth_m / self.settings.depth_scale_m)
        return Frames.from_steady(toward(speed, self.settings.toward_deg))
