"""A current that is the same everywhere, at all times."""

import numpy as np

from iout_marl.core.current import Frames
from iout_marl.core.grid import Grid
from iout_marl.parts.current.base import Current, Direction, Speed, currents, toward
from iout_marl.scenario import Scenario
from iout_marl.scenario.parts import Settings as PartSettings


@currents.register("uniform")
class Uniform(Current):
    """One velocity in all cells, at all times."""

    class Settings(PartSettings):
        #: Speed of the water.
        speed_m_per_s: Speed
        #: Direction that it flows to, clockwise from the grid's +y; where `grid.origin` turns the
        #: grid by a bearing it still counts from +y.
        toward_deg: Direction

    settings: Settings

    def frames(self, scenario: Scenario) -> Frames:
        velocity = toward(self.settings.speed_m_per_s, self.settings.toward_deg)
        num_cells = Grid.from_scenario(scenario).num_cells
        return Frames.from_steady(np.tile(velocity, (num_cells, 1)))
