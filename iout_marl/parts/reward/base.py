"""Rewards, term by term. Every term is negative where it hurts; the reward is their sum."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, TypeAlias

from iout_marl.arrays.backend import Backend
from iout_marl.core.state import Events, State
from iout_marl.parts.base import Context, Part
from iout_marl.physics.arrays import Array, pick
from iout_marl.registry import Registry
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import Plausible, Real, Term
from iout_marl.scenario.parts import Settings as PartSettings
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

    @abstractmethod
    def __call__(self, state: State, events: Events) -> Mapping[str, Array]:
        """The terms of a slot's reward, (envs, auvs) each; (envs, 1) is for all AUVs alike.

        Args:
            state: the state after the slot.
            events: what happened in it.
        """


rewards: Registry[type[Reward]] = Registry("reward", Reward)


class VehicleSettings(PartSettings):
    """Keys of a reward that has `VehicleTerms`."""

    #: Each kJ that the AUV draws from its battery (`vehicle.kind: battery`).
    vehicle_energy_penalty_per_kj: Annotated[Real, Plausible(-1e6, 1e6, "1/kJ")] = 0.0
    #: Each slot in which the AUV is stranded: its battery is empty.
    stranded_penalty: Term = 0.0

    hash_defaults: ClassVar[dict[str, Any]] = {
        "vehicle_energy_penalty_per_kj": 0.0,
        "stranded_penalty": 0.0,
    }

    def bounds_of_vehicles(self, scenario: Scenario) -> dict[str, float]:
        """As `Reward.bounds`, of these keys: in a slot an AUV draws no more than it can hold."""
        if not scenario.vehicle.part.is_limited:
            return {}
        most_kj = scenario.vehicle.part.capacity_j / 1000
        return {
            "reward.vehicle_energy_penalty_per_kj": (
                abs(self.vehicle_energy_penalty_per_kj) * most_kj
            ),
            "reward.stranded_penalty": abs(self.stranded_penalty),
        }


class VehicleTerms:
    """What the energy of an AUV costs it, and to be stranded; nothing where it has no end."""

    def __init__(self, settings: VehicleSettings, world: Context) -> None:
        is_limited, floats = world.scenario.vehicle.part.is_limited, world.backend.floats
        self._xp = world.backend.xp
        per_kj = settings.vehicle_energy_penalty_per_kj if is_limited else 0.0
        penalty = settings.stranded_penalty if is_limited else 0.0
        self._per_j = floats(-per_kj / 1000) if per_kj else None
        self._stranded = floats([0.0, -penalty]) if penalty else None

    def __call__(self, events: Events) -> dict[str, Array]:
        """Terms of a slot's reward, (envs, auvs) each."""
        terms = {}
        if self._per_j is not None:
            terms["vehicle_energy"] = events.drawn_j * self._per_j
        if self._stranded is not None:
            terms["stranded"] = pick(self._xp, self._stranded, events.stranded)
        return terms


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
