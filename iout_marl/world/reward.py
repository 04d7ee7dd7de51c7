"""Rewards, term by term. Every term is negative where it hurts; the reward is their sum."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from iout_marl.arrays.backend import Backend
from iout_marl.arrays.nodes import NodeAxis
from iout_marl.core.age import jain_of
from iout_marl.core.credit import Credit
from iout_marl.core.link import Link
from iout_marl.core.state import Events, State
from iout_marl.physics.arrays import Array, pick
from iout_marl.scenario import MeanAgeReward, PaperReward, Scenario


class Reward(Protocol):
    """A reward part."""

    def __call__(self, state: State, events: Events) -> Mapping[str, Array]:
        """The terms of a slot's reward, (envs, auvs) each.

        Args:
            state: the state after the slot.
            events: what happened in it.
        """
        ...


class WeightedAge:
    """(1/K) Σ δ_k A_k."""

    def __init__(self, scenario: Scenario, backend: Backend) -> None:
        self._weights = backend.floats([w / scenario.num_nodes for w in scenario.node_weights])
        self._all_alike = set(scenario.node_weights) == {1.0}

    def __call__(self, state: State) -> Array:
        """Of a state, (envs,)."""
        return state.mean_age if self._all_alike else self.of(state.age)

    def of(self, age: Array) -> Array:
        """Of (…, nodes) ages, (…)."""
        return age @ self._weights


class MeanAge:
    """r = −((1/K) Σ δ_k A_k + w (1 − J)), credited to the team or to each AUV for its part."""

    def __init__(
        self,
        settings: MeanAgeReward,
        age: WeightedAge,
        nodes: NodeAxis,
        credit: Credit,
        backend: Backend,
    ) -> None:
        self._age = age
        self._fairness_weight = settings.fairness_weight
        self._num_nodes = nodes.num_nodes
        self._credit = credit
        self._xp = backend.xp

    def __call__(self, state: State, events: Events) -> Mapping[str, Array]:  # noqa: ARG002
        share = self._credit.share
        terms = {"age": share(-self._age(state), lambda age, _: -self._age.of(age), state)}
        if self._fairness_weight:
            terms["fairness"] = share(self._fairness(state.jain), self._fairness_of, state)
        return terms

    def _fairness(self, jain: Array) -> Array:
        return self._fairness_weight * (jain - 1)

    def _fairness_of(self, age: Array, deliveries: Array) -> Array:  # noqa: ARG002
        return self._fairness(jain_of(self._xp, deliveries, self._num_nodes))


class Paper:
    """r = −(w 𝒟/K Σ δ_k A_k + ρ) with 𝒟 = 1 − J (eq. `reward function`).

    Ages and fairness are those of the network, credited to the team or to each AUV for
    its part; the penalties ρ (eq. `penalty term`) are each AUV's own.
    """

    def __init__(
        self,
        settings: PaperReward,
        age: WeightedAge,
        scenario: Scenario,
        link: Link,
        nodes: NodeAxis,
        credit: Credit,
        backend: Backend,
    ) -> None:
        self._settings = settings
        self._credit = credit
        self._link = link
        self._nodes = nodes
        self._xp = backend.xp
        self._age = age
        self._is_fdd = scenario.duplex.kind == "fdd"
        self._weight = backend.floats(-settings.age_weight)
        self._one = backend.floats(1.0)
        #: No penalty, and each penalty, as rewards; some as what holds without and with it.
        self._none = backend.floats(0.0)
        self._location = backend.floats([0.0, -settings.location_penalty])
        self._separation = backend.floats([0.0, -settings.separation_penalty])
        self._occurrence = backend.floats([0.0, -settings.occurrence_penalty])
        self._is_alone = scenario.num_auvs == 1
        self._no_able_node = backend.floats(-settings.no_able_node_penalty)
        self._wrong_node = backend.floats(-settings.wrong_node_penalty)
        self._only_charging = backend.floats(-settings.only_charging_penalty)
        self._only_transmitting = backend.floats(-settings.only_transmitting_penalty)
        self._missed = backend.floats([-settings.wrong_node_penalty, 0.0])
        self._ideal_deliveries = backend.floats(scenario.num_slots / scenario.num_nodes)

    def __call__(self, state: State, events: Events) -> Mapping[str, Array]:
        settings, xp, nodes = self._settings, self._xp, self._nodes
        age = self._weight * (self._one - state.jain) * self._age(state)
        served = nodes.chosen(state.deliveries, nodes.place(events.heard))
        overserved = events.delivered & (served > self._ideal_deliveries)
        terms = {
            "age": self._credit.share(age, self._discriminated_age, state),
            "location": pick(xp, self._location, events.left_grid),
            "information": self._fdd(state, events) if self._is_fdd else self._tdd(events),
            "occurrence": pick(xp, self._occurrence, overserved),
        }
        if not self._is_alone:
            terms["separation"] = pick(xp, self._separation, events.blocked)
        if settings.unserved_penalty:
            unserved = nodes.sum(xp.astype(state.deliveries == 0, state.age.dtype))
            terms["unserved"] = nodes.alike(-settings.unserved_penalty * unserved)
        return terms

    def _discriminated_age(self, age: Array, deliveries: Array) -> Array:
        """The age term of (…, nodes) ages and deliveries: (…)."""
        jain = jain_of(self._xp, deliveries, self._nodes.num_nodes)
        return self._weight * (self._one - jain) * self._age.of(age)

    def _fdd(self, state: State, events: Events) -> Array:
        """Eq. `penalty for missed information fdd`: no node, or the wrong one, heard."""
        settings, xp, link = self._settings, self._xp, self._link
        if settings.no_able_node_penalty == settings.wrong_node_penalty:
            return pick(xp, self._missed, events.delivered)
        offset = link.offset(state.cell[:, :, None], state.node_cell[:, None, :])
        able = events.payable_j[:, None, :] > link.at(link.slot_uplink_j, offset)
        penalty = xp.where(xp.any(able, axis=2), self._wrong_node, self._no_able_node)
        return xp.where(events.delivered, self._none, penalty)

    def _tdd(self, events: Events) -> Array:
        """Eq. `penalty for missed information tdd`: only charging, or only transmitting."""
        xp = self._xp
        penalty = xp.where(events.beta == 1, self._only_charging, self._none)
        if self._settings.only_transmitting_penalty:
            penalty = xp.where(events.beta == 0, self._only_transmitting, penalty)
        return penalty


def make_reward(
    scenario: Scenario, link: Link, nodes: NodeAxis, credit: Credit, backend: Backend
) -> Reward:
    """The reward part that a scenario names."""
    age = WeightedAge(scenario, backend)
    if isinstance(scenario.reward, MeanAgeReward):
        return MeanAge(scenario.reward, age, nodes, credit, backend)
    return Paper(scenario.reward, age, scenario, link, nodes, credit, backend)
