"""Two gyres side by side."""

from typing import Annotated

import numpy as np
from pydantic import Field

from iout_marl.core.current import Frames
from iout_marl.core.grid import Floats
from iout_marl.parts.current.base import (
    Current,
    Period,
    Speed,
    check_size,
    currents,
    middles_s,
    positions_m,
)
from iout_marl.scenario import Scenario
from iout_marl.scenario.parts import Settings as PartSettings


@currents.register("double_gyre")
class DoubleGyre(Current):
    """Two gyres side by side, which take turns in being the larger one (Shadden et al. 2005).

    ψ = A sin(πf) sin(πy), f = ε sin(ωt) x² + (1 − 2ε sin(ωt)) x, on 0 ≤ x ≤ 2 and 0 ≤ y ≤ 1, which
    is scaled to the grid, from edge to edge; the same at all depths. Nothing flows through the
    edges.
    """

    class Settings(PartSettings):
        #: πA over the grid's extent along y: the highest speed along x.
        amplitude_m_per_s: Speed
        #: ε, how far the line between the gyres moves: 0 for steady ones.
        epsilon: Annotated[float, Field(ge=0, le=0.5)] = 0.25
        #: 2π/ω, the time in which it moves to and fro.
        period_h: Period = 12.42

    settings: Settings

    def frames(self, scenario: Scenario) -> Frames:
        edges_m, cells = np.array(scenario.grid.edges_m[:2]), np.array(scenario.grid.cells[:2])
        size_m = edges_m * cells
        # Centres of cells, on [0, 2] × [0, 1].
        x, y = ((positions_m(scenario)[:, :2] + edges_m / 2) / size_m * np.array([2.0, 1.0])).T
        times_s = middles_s(scenario)
        if self.settings.epsilon == 0:
            return Frames.from_steady(self.velocity(x, y, 0.0, size_m))
        check_size(len(times_s) + 1, scenario)
        omega = 2 * np.pi / (3600 * self.settings.period_h)
        sines = self.settings.epsilon * np.sin(omega * times_s)
        fields = np.stack([self.velocity(x, y, sine, size_m) for sine in [*sines, sines[-1]]])
        return Frames(fields, np.arange(len(times_s)), np.zeros(len(times_s)))

    def velocity(self, x: Floats, y: Floats, shift: float, size_m: Floats) -> Floats:
        """(points, 2) velocities along x and y in m/s.

        Args:
            x, y: (points,) places on [0, 2] × [0, 1].
            shift: ε sin(ωt).
            size_m: of the grid along x and y.
        """
        f, slope = shift * x**2 + (1 - 2 * shift) * x, 2 * shift * x + 1 - 2 * shift
        along_x = -np.sin(np.pi * f) * np.cos(np.pi * y)
        along_y = np.cos(np.pi * f) * np.sin(np.pi * y) * slope
        # A stream function over lengths that differ: what flows along the longer is the faster.
        stretch = 2 * size_m[1] / size_m[0]
        return self.settings.amplitude_m_per_s * np.stack([along_x, along_y * stretch], axis=-1)
