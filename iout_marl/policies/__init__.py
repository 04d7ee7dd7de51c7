"""Policies: what one is, those that need no training, and how all of them are called."""

from typing import Any

from iout_marl.deprecated import warn_renamed
from iout_marl.policies.baselines import Greedy, RandomWalk, RoundRobin
from iout_marl.policies.chance import EpisodeStreams
from iout_marl.policies.loading import AnyPolicy, as_policy, load_policy, policy_for
from iout_marl.policies.named import BASELINES, POLICIES, make_baseline
from iout_marl.policies.planned import BestOf, GuidedBeam, PlannerPolicy, Tour
from iout_marl.policies.policy import Actions, Policy, chosen_by, is_deterministic, take_actions
from iout_marl.policies.predicting import BasePolicy, ObservationPolicy
from iout_marl.policies.returning import Return
from iout_marl.policies.search import DEFAULT_BUDGET, Budget

__all__ = [
    "BASELINES",
    "DEFAULT_BUDGET",
    "POLICIES",
    "Actions",
    "AnyPolicy",
    "BasePolicy",
    "BestOf",
    "Budget",
    "EpisodeStreams",
    "Greedy",
    "GuidedBeam",
    "ObservationPolicy",
    "PlannerPolicy",
    "Policy",
    "RandomWalk",
    "Return",
    "RoundRobin",
    "Tour",
    "as_policy",
    "chosen_by",
    "is_deterministic",
    "load_policy",
    "make_baseline",
    "policy_for",
    "take_actions",
]

#: What names of the version before are called now.
_RENAMED = {"UNTRAINED": "POLICIES", "USUAL": "DEFAULT_BUDGET"}


def __getattr__(name: str) -> Any:
    if name not in _RENAMED:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    warn_renamed(f"iout_marl.policies.{name}", f"iout_marl.policies.{_RENAMED[name]}")
    return globals()[_RENAMED[name]]
