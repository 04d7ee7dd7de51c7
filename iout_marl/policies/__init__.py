"""Policies that need no training, and what a policy is."""

from iout_marl.errors import InputError, did_you_mean
from iout_marl.policies.baselines import Greedy, RandomWalk, RoundRobin
from iout_marl.policies.policy import Actions, ObservationPolicy, Policy
from iout_marl.policies.tour import Tour

#: The baselines by name, in the order in which tables list them.
BASELINES: dict[str, type[RandomWalk] | type[RoundRobin] | type[Greedy] | type[Tour]] = {
    p.name: p for p in (RandomWalk, RoundRobin, Greedy, Tour)
}


def make_baseline(name: str) -> Policy:
    """The baseline of that name.

    Raises:
        InputError: no such baseline.
    """
    if name not in BASELINES:
        raise InputError(f"no policy {name!r}{did_you_mean(name, BASELINES)}")
    return BASELINES[name]()


__all__ = [
    "BASELINES",
    "Actions",
    "Greedy",
    "ObservationPolicy",
    "Policy",
    "RandomWalk",
    "RoundRobin",
    "Tour",
    "make_baseline",
]
