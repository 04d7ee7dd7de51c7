"""The paper's reward."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

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
from iout_marl.physics.arrays import Array, add_up, pick
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import Term


@rewards.register("paper")
class Paper(Reward):
    """r = −(w 𝒟/K Σ δ_k A_k + ρ) with 𝒟 = 1 − J (eq. `reward function`).

    Ages and fairness are those of the network, credited to the team or to each AUV for
    its part; the penalties ρ (eq. `penalty term`) are each AUV's own. Penalties are subtracted: a
    negative one is a bonus.
    """

    class Settings(VehicleSettings):
        #: w, a factor on the discriminated age; the paper's is 1.
        age_weight: Term = 1.0
        #: A move out of the grid.
        location_penalty: Term = 10.0
        #: A move that came too near another AUV's (see `auvs.separation_cells`).
        separation_penalty: Term = 10.0
        #: FDD: the uplink failed, and no node could have paid one. Where nobody was asked, nothing
        #: has failed.
        no_able_node_penalty: Term = 4.0
        #: FDD: the uplink failed, and another node could have paid one.
        wrong_node_penalty: Term = 4.0
        #: TDD: β = 1.
        only_charging_penalty: Term = 4.0
        #: TDD: β = 0.
        only_transmitting_penalty: Term = 0.0
        #: Data taken from a node that was served more than T/K times; for each such node.
        occurrence_penalty: Term = 10.0
        #: Each node not served so far in the episode, in every slot.
        unserved_penalty: Term = 0.0
        #: Whom the age of the network is credited to: `team`, every AUV gets it; `difference`,
        #: every AUV gets what it has added (Wolpert and Tumer, 2001).
        credit: Credit = "team"

        hash_defaults: ClassVar[dict[str, Any]] = {
            "credit": "team",
            "separation_penalty": 10.0,
            **VehicleSettings.hash_defaults,
        }

    settings: Settings

    def bounds(self, scenario: Scenario) -> dict[str, float]:
        settings, mean_age = self.settings, most_mean_age(scenario)
        penalties = {
            f"reward.{name}": abs(value)
            for name, value in settings.model_dump().items()
            if name.endswith("_penalty") and name not in VehicleSettings.hash_defaults
        }
        penalties["reward.unserved_penalty"] *= scenario.num_nodes
        penalties["reward.occurrence_penalty"] *= min(
            scenario.hearing.part.uplinks_per_slot, scenario.num_nodes
        )
        weighted = mean_age * abs(settings.age_weight)
        key = "nodes.weights" if mean_age > abs(settings.age_weight) else "reward.age_weight"
        return {key: weighted} | penalties | settings.bounds_of_vehicles(scenario)

    def setup(self, world: Context) -> None:
        super().setup(world)
        settings, backend = self.settings, world.backend
        self._credit = world.credit
        self._vehicle = VehicleTerms(settings, world)
        self._link = world.link
        self._nodes = world.nodes
        self._age = WeightedAge(world.scenario, backend)
        self._splits_slot = world.scenario.duplex.part.splits_slot
        self._weight = backend.floats(-settings.age_weight)
        self._one = backend.floats(1.0)
        #: No penalty, and each penalty, as rewards; some as what holds without and with it.
        self._none = backend.floats(0.0)
        self._location = backend.floats([0.0, -settings.location_penalty])
        self._separation = backend.floats([0.0, -settings.separation_penalty])
        self._occurrence = backend.floats([0.0, -settings.occurrence_penalty])
        self._rounds = world.scenario.hearing.part.rounds(world.scenario.num_nodes)
        self._is_alone = world.scenario.num_auvs == 1
        self._may_be_idle = world.scenario.may_be_idle
        self._nobody = backend.integers(world.scenario.num_nodes)
        self._no_able_node = backend.floats(-settings.no_able_node_penalty)
        self._wrong_node = backend.floats(-settings.wrong_node_penalty)
        self._only_charging = backend.floats(-settings.only_charging_penalty)
        self._only_transmitting = backend.floats(-settings.only_transmitting_penalty)
        self._missed = backend.floats([-settings.wrong_node_penalty, 0.0])
        self._ideal_deliveries = backend.floats(world.scenario.num_slots / world.scenario.num_nodes)

    def __call__(self, state: State, events: Events) -> Mapping[str, Array]:
        settings, xp, nodes = self.settings, self.xp, self._nodes
        age = self._weight * (self._one - state.jain) * self._age(state)
        served = nodes.gather(state.deliveries, nodes.flat_index(events.heard))
        overserved = events.delivered & (served > self._ideal_deliveries)
        terms = {
            "age": self._credit.share(age, self._discriminated_age, state),
            "location": pick(xp, self._location, events.left_grid),
            "information": self._information(state, events),
            "occurrence": pick(xp, self._occurrence, overserved),
        }
        if self._rounds:
            served = nodes.gather(state.deliveries, nodes.flat_index(events.polled))
            overserved = events.polled_delivered & (served > self._ideal_deliveries)
            penalties = pick(xp, self._occurrence, overserved)
            terms["occurrence"] = terms["occurrence"] + add_up(xp, penalties, 2)
        if not self._is_alone:
            terms["separation"] = pick(xp, self._separation, events.blocked)
        if settings.unserved_penalty:
            unserved = nodes.sum(xp.astype(state.deliveries == 0, state.age.dtype))
            terms["unserved"] = nodes.broadcast_to_auvs(-settings.unserved_penalty * unserved)
        return terms | self._vehicle(events)

    def _discriminated_age(self, age: Array, deliveries: Array) -> Array:
        """The age term of (…, nodes) ages and deliveries: (…)."""
        jain = jain_of(self.xp, deliveries, self._nodes.num_nodes)
        return self._weight * (self._one - jain) * self._age.mean(age)

    def _information(self, state: State, events: Events) -> Array:
        penalty = self._split(events) if self._splits_slot else self._missed_data(state, events)
        if self._may_be_idle:
            penalty = self.xp.where(events.heard < self._nobody, penalty, self._none)
        return penalty

    def _missed_data(self, state: State, events: Events) -> Array:
        """Eq. `penalty for missed information fdd`: no node, or the wrong one, heard."""
        settings, xp, link = self.settings, self.xp, self._link
        if settings.no_able_node_penalty == settings.wrong_node_penalty:
            return pick(xp, self._missed, events.delivered)
        offset = link.offset(state.cell[:, :, None], state.node_cell[:, None, :])
        able = events.available_j[:, None, :] > link.at(link.slot_uplink_j, offset)
        penalty = xp.where(xp.any(able, axis=2), self._wrong_node, self._no_able_node)
        return xp.where(events.delivered, self._none, penalty)

    def _split(self, events: Events) -> Array:
        """Eq. `penalty for missed information tdd`: only charging, or only transmitting."""
        xp = self.xp
        penalty = xp.where(events.beta == 1, self._only_charging, self._none)
        if self.settings.only_transmitting_penalty:
            penalty = xp.where(events.beta == 0, self._only_transmitting, penalty)
        return penalty
