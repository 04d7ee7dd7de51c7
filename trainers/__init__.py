"""PPO in plain torch on the batched world of `iout_marl`. Names are imported when asked for."""

import importlib
from typing import TYPE_CHECKING, Any

from iout_marl.deprecated import warn_renamed

if TYPE_CHECKING:
    from trainers.accel.group import ProcessGroup
    from trainers.accel.processes import started_group
    from trainers.callbacks import Callback
    from trainers.ppo import Trainer
    from trainers.runs.folder import RunFolder
    from trainers.trained import TrainedPolicy
    from trainers.training import TrainingOutcome, find_device, train
    from trainers.training_run import DivergedError, TrainingRun

_MODULES = {
    "Callback": "trainers.callbacks",
    "DivergedError": "trainers.training_run",
    "ProcessGroup": "trainers.accel.group",
    "RunFolder": "trainers.runs.folder",
    "TrainedPolicy": "trainers.trained",
    "Trainer": "trainers.ppo",
    "TrainingRun": "trainers.training_run",
    "TrainingOutcome": "trainers.training",
    "find_device": "trainers.training",
    "started_group": "trainers.accel.processes",
    "train": "trainers.training",
}

__all__ = [
    "Callback",
    "DivergedError",
    "ProcessGroup",
    "RunFolder",
    "TrainedPolicy",
    "Trainer",
    "TrainingOutcome",
    "TrainingRun",
    "find_device",
    "started_group",
    "train",
]


#: What names of the version before are called now.
_RENAMED = {"Group": "ProcessGroup"}


def __getattr__(name: str) -> Any:
    if name in _RENAMED:
        warn_renamed(f"trainers.{name}", f"trainers.{_RENAMED[name]}")
        return __getattr__(_RENAMED[name])
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(importlib.import_module(_MODULES[name]), name)
    globals()[name] = found
    return found
