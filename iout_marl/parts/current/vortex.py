"""A vortex."""

from typing import Annotated

import numpy as np
from pydantic import Field

from iout_marl.core.current import Frames
from iout_marl.parts.current.base import Current, currents, positions_m
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import Plausible, Positive, Real
from iout_marl.scenario.parts import Settings as PartSettings

#: Metres in the grid, from the centre of cell (1, 1, 1).
_Metres = Annotated[Real, Plausible(-1e6, 1e6, "m")]


@currents.register("vortex")
class Vortex(Current):
    """A steady vortex about a vertical axis after Lamb and Oseen, at rest in its centre.

    u_θ(r) = Γ/(2πr) (1 − e^(−r²/δ²)), the same at all depths.
    """

    class Settings(PartSettings):
        #: Γ, above 0 for a vortex that turns from +x to +y; where z points down and +x lies to the
        #: right of +y, that is against the clock as seen from above.
        circulation_m2_per_s: Annotated[Real, Plausible(-1e6, 1e6, "m²/s")]
        #: δ, the radius of its core; the water is fastest at 1.12 times it.
        core_radius_m: Annotated[Positive, Plausible(0.1, 1e6, "m")]
        #: Its axis, x and y in m from the centre of cell (1, 1, 1).
        center_m: Annotated[tuple[_Metres, _Metres], Field(strict=False)]

    settings: Settings

    def frames(self, scenario: Scenario) -> Frames:
        x_m, y_m = (positions_m(scenario)[:, :2] - np.array(self.settings.center_m)).T
        squared, core = x_m**2 + y_m**2, self.settings.core_radius_m**2
        # u_θ / r, which has a limit in the centre.
        share = np.divide(-np.expm1(-squared / core), squared, where=squared > 0, out=0 * squared)
        per_s = np.where(squared > 0, share, 1 / core)
        per_s = per_s * self.settings.circulation_m2_per_s / (2 * np.pi)
        return Frames.from_steady(np.stack([-y_m * per_s, x_m * per_s], axis=-1))
