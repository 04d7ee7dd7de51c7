"""Policies: what one is, those that need no training, and how all of them are called."""

from iout_marl.policies.baselines import Greedy, RandomWalk, RoundRobin
from iout_marl.policies.chance import EpisodeStreams
from iout_marl.policies.loading import AnyPolicy, as_policy, load_policy, policy_for
from iout_marl.policies.named import BASELINES, UNTRAINED, make_baseline
from iout_marl.policies.planned import PlannerPolicy, Tour
from iout_marl.policies.policy import Actions, Policy, is_deterministic, take_actions
from iout_marl.policies.predicting import BasePolicy, ObservationPolicy
from iout_marl.policies.search import USUAL, Budget

__all__ = [
    "BASELINES",
    "UNTRAINED",
    "USUAL",
    "Actions",
    "AnyPolicy",
    "BasePolicy",
    "Budget",
    "EpisodeStreams",
    "Greedy",
    "ObservationPolicy",
    "PlannerPolicy",
    "Policy",
    "RandomWalk",
    "RoundRobin",
    "Tour",
    "as_policy",
    "is_deterministic",
    "load_policy",
    "make_baseline",
    "policy_for",
    "take_actions",
]
