"""The mean age as a reward."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

from iout_marl.core.age import jain_of
from iout_marl.core.state import Events, State
from iout_marl.parts.base import Context
from iout_marl.parts.reward.base import (
    Credit,
    Reward,
    VehicleSettings,
    VehicleTerms,
    WeightedAge,
    most_mean_age,
    rewards,
)
from iout_marl.physics.arrays import Array
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import NonNegative, Plausible


@rewards.register("mean_age")
class MeanAge(Reward):
    """r = −((1/K) Σ δ_k A_k + w (1 − J)), credited to the team or to each AUV for its part."""

    class Settings(VehicleSettings):
        #: w, in slots of mean age: what fairness is worth. Where the paper multiplies, this adds.
        fairness_weight: Annotated[NonNegative, Plausible(0, 1e6, "slots")] = 0.0
        #: Whom the age of the network is credited to: `team`, every AUV gets it; `difference`,
        #: every AUV gets what it has added (Wolpert and Tumer, 2001).
        credit: Credit = "team"

        hash_defaults: ClassVar[dict[str, Any]] = {
            "credit": "team",
            "fairness_weight": 0.0,
            **VehicleSettings.hash_defaults,
        }

    settings: Settings

    def bounds(self, scenario: Scenario) -> dict[str, float]:
        return {
            "nodes.weights": most_mean_age(scenario),
            "reward.fairness_weight": self.settings.fairness_weight,
            **self.settings.bounds_of_vehicles(scenario),
        }

    def setup(self, world: Context) -> None:
        super().setup(world)
        self._age = WeightedAge(world.scenario, world.backend)
        self._fairness_weight = self.settings.fairness_weight
        self._num_nodes = world.nodes.num_nodes
        self._credit = world.credit
        self._vehicle = VehicleTerms(self.settings, world)

    def __call__(self, state: State, events: Events) -> Mapping[str, Array]:
        share = self._credit.share
        terms = {"age": share(-self._age(state), lambda age, _: -self._age.mean(age), state)}
        if self._fairness_weight:
            terms["fairness"] = share(self._fairness(state.jain), self._fairness_of, state)
        return terms | self._vehicle(events)

    def _fairness(self, jain: Array) -> Array:
        return self._fairness_weight * (jain - 1)

    def _fairness_of(self, age: Array, deliveries: Array) -> Array:  # noqa: ARG002
        return self._fairness(jain_of(self.xp, deliveries, self._num_nodes))
