"""The policies that need no training, by name."""

from __future__ import annotations

from collections.abc import Callable

from iout_marl.errors import InputError, did_you_mean
from iout_marl.policies.baselines import Greedy, RandomWalk, RoundRobin
from iout_marl.policies.planned import PlannerPolicy, Tour
from iout_marl.policies.predicting import BasePolicy
from iout_marl.policies.returning import Return

#: What plays by weights that come with the package.
PRETRAINED = "pretrained"


def _pretrained() -> BasePolicy:
    from trainers.pretrained import Pretrained  # takes torch along

    return Pretrained()


#: The baselines by name, in the order in which tables list them.
BASELINES: dict[str, Callable[[], BasePolicy]] = {
    "random-walk": RandomWalk,
    "round-robin": RoundRobin,
    "greedy": Greedy,
    "tour": Tour,
}
#: All that need no training of one's own: those, one for AUVs with batteries and docks, one that
#: was trained on many scenarios, and one that takes its time for every layout.
POLICIES: dict[str, Callable[[], BasePolicy]] = {
    "return": Return,
    PRETRAINED: _pretrained,
    **BASELINES,
    "planner": PlannerPolicy,
}


def make_baseline(name: str) -> BasePolicy:
    """The policy of that name, ready to play.

    Raises:
        InputError: no such policy.
    """
    if name not in POLICIES:
        raise InputError(f"no policy {name!r}{did_you_mean(name, POLICIES)}")
    return POLICIES[name]()
