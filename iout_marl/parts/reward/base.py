"""Rewards, term by term. Every term is negative where it hurts; the reward is their sum."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal, TypeAlias

from iout_marl.arrays.backend import Backend
from iout_marl.core.state import Events, State
from iout_marl.parts.base import Part
from iout_marl.physics.arrays import Array
from iout_marl.registry import Registry
from iout_marl.scenario import Scenario
from iout_marl.whole import is_number, short

#: Whom the network's age term is credited to. `team`: every AUV gets it. `difference`: every AUV
#: gets what it has added (Wolpert and Tumer, 2001): the term less what it would be had no packet
#: ever reached this AUV, all else alike.
Credit: TypeAlias = Literal["team", "difference"]


class Reward(Part):
    """What a slot is worth to each AUV.

    Settings may have the key `credit`: `team` or `difference`.
    """

    @property
    def is_credited_apart(self) -> bool:
        """Whether each AUV is credited with what it has added to the network."""
        return getattr(self.settings, "credit", "team") == "difference"

    def bounds(self, scenario: Scenario) -> dict[str, float]:  # noqa: ARG002
        """By key: how large it can make the reward of a slot. Nothing where that is not known."""
        return {}

    def check_stated(self, scenario: Scenario) -> None:
        bounds = self.bounds(scenario)
        if not (isinstance(bounds, dict) and all(is_number(bound, 0) for bound in bounds.values())):
            raise self.fault(
                f"bounds() must map keys of the scenario to numbers from 0, not {short(bounds)}"
            )

    def __call__(self, state: State, events: Events) -> Mapping[str, Array]:
        """The terms of a slot's reward, (envs, auvs) each; (envs, 1) is for all AUVs alike.

        Args:
            state: the state after the slot.
            events: what happened in it.
        """
        raise NotImplementedError


rewards: Registry[type[Reward]] = Registry("reward", Reward)


class WeightedAge:
    """(1/K) Σ δ_k A_k."""

    def __init__(self, scenario: Scenario, backend: Backend) -> None:
        self._weights = backend.floats([w / scenario.num_nodes for w in scenario.node_weights])
        self._all_alike = set(scenario.node_weights) == {1.0}

    def __call__(self, state: State) -> Array:
        """The weighted mean age of a state, (envs,)."""
        return state.mean_age if self._all_alike else self.mean(state.age)

    def mean(self, age: Array) -> Array:
        """The weighted mean, (…), of (…, nodes) ages."""
        return age @ self._weights


def most_mean_age(scenario: Scenario) -> float:
    """How large (1/K) Σ δ_k A_k can become."""
    oldest = min(scenario.age.maximum, scenario.age.initial + scenario.num_slots)
    return oldest * (math.fsum(w / scenario.num_nodes for w in scenario.node_weights))
