"""A current that changes by chance."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from iout_marl.core.chance import Draw
from iout_marl.core.current import Frames, Wander
from iout_marl.core.grid import Grid
from iout_marl.parts.current.base import Current, Direction, Speed, currents, toward
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import NonNegative, Plausible, Positive
from iout_marl.scenario.parts import Settings as PartSettings


@currents.register("gauss_markov")
class GaussMarkov(Current):
    """A current that is the same everywhere and wanders about its mean by a Gauss–Markov process.

    To either component of the mean it adds g: σ n in the first slot, and from slot to slot
    g' = ρ g + √(1 − ρ²) σ n with ρ = e^(−τ/T) and n standard normal. It is cut off at 4 σ, so that
    the current has a highest speed.
    """

    class Settings(PartSettings):
        #: Mean speed of the water.
        speed_m_per_s: Speed
        #: Direction that the mean flows to, clockwise from the grid's +y.
        toward_deg: Direction
        #: σ, the standard deviation of either component.
        sigma_m_per_s: Annotated[NonNegative, Plausible(0, 1, "m/s", slips=(1e-2, 1e-3))]
        #: T, over which what chance has added falls to 37 %.
        time_constant_h: Annotated[Positive, Plausible(1e-3, 1e3, "h")] = 1.0

    settings: Settings

    def draws(self, scenario: Scenario) -> dict[str, Draw]:  # noqa: ARG002
        return {"current": Draw("normal", (2,))}

    def wander(self, scenario: Scenario) -> Wander:  # noqa: ARG002
        return Wander(self.settings.sigma_m_per_s, 3600 * self.settings.time_constant_h)

    def frames(self, scenario: Scenario) -> Frames:
        mean = toward(self.settings.speed_m_per_s, self.settings.toward_deg)
        return Frames.from_steady(np.tile(mean, (Grid.from_scenario(scenario).num_cells, 1)))
