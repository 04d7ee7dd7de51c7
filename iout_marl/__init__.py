"""AUVs that charge underwater sensor nodes by sound and collect their data.

The environment's page is `iout_marl.iout_v0`; what there is in Python, `docs/python.md`.
"""

# isort: off
from iout_marl import startup  # before all that takes its time
# isort: on

import importlib
from typing import TYPE_CHECKING, Any

from iout_marl.deprecated import warn_renamed

if TYPE_CHECKING:
    from iout_marl import iout_v0
    from iout_marl.bounds.bound import bound
    from iout_marl.errors import InputError
    from iout_marl.evaluation import Evaluation, evaluate
    from iout_marl.policies import Policy, load_policy, make_baseline
    from iout_marl.replay import Recording, record, record_policy
    from iout_marl.scenario import Scenario, bundled_names, load_scenario
    from iout_marl.trajectory import Trajectory, record_episode
    from iout_marl.world import World
    from trainers.ppo import Trainer
    from trainers.pretrained import pretrained
    from trainers.training import train

__version__ = "0.1.0"

#: Where each name is, which is imported when it is first asked for.
_PLACES = {
    "Evaluation": "iout_marl.evaluation",
    "InputError": "iout_marl.errors",
    "Policy": "iout_marl.policies",
    "Recording": "iout_marl.replay",
    "Scenario": "iout_marl.scenario",
    "Trainer": "trainers",
    "Trajectory": "iout_marl.trajectory",
    "World": "iout_marl.world",
    "bound": "iout_marl.bounds",
    "bundled_names": "iout_marl.scenario",
    "evaluate": "iout_marl.evaluation",
    "load_policy": "iout_marl.policies",
    "load_scenario": "iout_marl.scenario",
    "make_baseline": "iout_marl.policies",
    "pretrained": "trainers.pretrained",
    "record": "iout_marl.replay",
    "record_episode": "iout_marl.trajectory",
    "record_policy": "iout_marl.replay",
    "train": "trainers",
}

__all__ = [
    "Evaluation",
    "InputError",
    "Policy",
    "Recording",
    "Scenario",
    "Trainer",
    "Trajectory",
    "World",
    "bound",
    "bundled_names",
    "evaluate",
    "iout_v0",
    "load_policy",
    "load_scenario",
    "make_baseline",
    "pretrained",
    "record",
    "record_episode",
    "record_policy",
    "train",
]


#: What names of the version before are called now.
_RENAMED = {"Episode": "Trajectory"}


def __getattr__(name: str) -> Any:
    if name in _RENAMED:
        warn_renamed(f"iout_marl.{name}", f"iout_marl.{_RENAMED[name]}")
        return __getattr__(_RENAMED[name])
    if name == "iout_v0":
        return importlib.import_module("iout_marl.iout_v0")
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(importlib.import_module(_PLACES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


if not startup.is_command_line():  # whose own commands need neither registry
    from iout_marl.registration import register

    register()
