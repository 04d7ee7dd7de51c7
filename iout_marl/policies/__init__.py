"""Policies that need no training, and what a policy is."""

from collections.abc import Callable

from iout_marl.errors import InputError, did_you_mean
from iout_marl.policies.baselines import Greedy, RandomWalk, RoundRobin
from iout_marl.policies.chance import EpisodeStreams
from iout_marl.policies.planned import PlannerPolicy, Tour
from iout_marl.policies.policy import Actions, ObservationPolicy, Policy, is_deterministic
from iout_marl.policies.search import USUAL, Budget

#: The baselines by name, in the order in which tables list them.
BASELINES: dict[str, Callable[[], Policy]] = {
    "random-walk": RandomWalk,
    "round-robin": RoundRobin,
    "greedy": Greedy,
    "tour": Tour,
}
#: All that need no training: those, and one that takes its time for every layout.
UNTRAINED: dict[str, Callable[[], Policy]] = {**BASELINES, "planner": PlannerPolicy}


def make_baseline(name: str) -> Policy:
    """The untrained policy of that name.

    Raises:
        InputError: no such policy.
    """
    if name not in UNTRAINED:
        raise InputError(f"no policy {name!r}{did_you_mean(name, UNTRAINED)}")
    return UNTRAINED[name]()


__all__ = [
    "BASELINES",
    "UNTRAINED",
    "USUAL",
    "Actions",
    "Budget",
    "EpisodeStreams",
    "Greedy",
    "ObservationPolicy",
    "PlannerPolicy",
    "Policy",
    "RandomWalk",
    "RoundRobin",
    "Tour",
    "is_deterministic",
    "make_baseline",
]
