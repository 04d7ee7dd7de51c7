"""Log-normal shadowing that changes over time."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from iout_marl.core.chance import Chance
from iout_marl.core.state import State
from iout_marl.core.wandering import Wandering
from iout_marl.parts.base import Context
from iout_marl.parts.fading.base import Fading, fadings
from iout_marl.physics.arrays import Array
from iout_marl.scenario.fields import Plausible, Positive
from iout_marl.scenario.parts import Settings as PartSettings

#: Up to how many standard deviations a harvest counts a gain.
MOST_SIGMAS = 6.0


@fadings.register("shadowing")
class Shadowing(Fading):
    """Log-normal shadowing of each link, whose autocorrelation decays exponentially.

    g_t = ρ g_{t−1} + √(1 − ρ²) σ n with ρ = e^(−τ/T_c) in dB, of the same spread in every slot, by
    Qarabaqi and Stojanovic (IEEE J. Oceanic Eng. 38, 2013). Links are independent of one another,
    and of where the AUV goes. It takes a channel of consistent units, such as `sonar`.
    """

    class Settings(PartSettings):
        #: Standard deviation σ of the level.
        sigma_db: Annotated[float, Field(gt=0, le=60), Plausible(0.1, 12, "dB")]
        #: T_c: after so long the correlation has fallen to 1/e.
        coherence_s: Annotated[Positive, Plausible(1, 86_400, "s")]

    settings: Settings
    is_active = True

    @property
    def most_db(self) -> float:
        return MOST_SIGMAS * self.settings.sigma_db

    def setup(self, world: Context) -> None:
        super().setup(world)
        own = self.settings
        self._wandering = Wandering(
            world.backend, own.sigma_db, own.coherence_s, world.scenario.slot_s
        )

    def gain_db(self, state: State, chance: Chance) -> Array:
        return self._wandering.after(state.gain_db, chance.fading, state.slot)
