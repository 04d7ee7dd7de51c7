"""Wind that wanders around its mean."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from iout_marl.core.chance import Chance, Draw
from iout_marl.core.state import State
from iout_marl.core.wandering import Wandering
from iout_marl.parts.base import Context
from iout_marl.parts.wind.base import Blowing, Wind, winds
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import Plausible, Positive
from iout_marl.scenario.parts import Settings as PartSettings

#: Up to how many standard deviations above the mean noise grows.
_MOST_SIGMAS = 8.0


@winds.register("gauss_markov")
class GaussMarkov(Wind):
    """Wind that wanders around `channel.wind_m_per_s` as a Gauss-Markov process, never below 0."""

    class Settings(PartSettings):
        #: Standard deviation of the speed.
        sigma_m_per_s: Annotated[Positive, Field(le=100), Plausible(0.01, 15, "m/s")]
        #: After so long the correlation has fallen to 1/e.
        coherence_s: Annotated[Positive, Plausible(60, 1e6, "s")]

    settings: Settings
    changes = is_drawn = True

    def draws(self, scenario: Scenario) -> dict[str, Draw]:
        return {"wind": Draw("normal", (1,))} if self.matters(scenario) else {}

    def most_m_per_s(self, mean_m_per_s: float) -> float:
        return mean_m_per_s + _MOST_SIGMAS * self.settings.sigma_m_per_s

    def setup(self, world: Context) -> None:
        super().setup(world)
        own, scenario = self.settings, world.scenario
        self._wandering = Wandering(
            world.backend, own.sigma_m_per_s, own.coherence_s, scenario.slot_s
        )
        self._mean = world.backend.floats(scenario.channel.wind_m_per_s)
        self._calm = world.backend.floats(0.0)

    def blowing(self, state: State, chance: Chance) -> Blowing:
        gust = self._wandering.after(state.gust_m_per_s, chance.wind, state.slot)
        return Blowing(self.xp.maximum(self._mean + gust, self._calm), gust)
