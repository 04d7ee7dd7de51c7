"""PPO in plain torch on the batched world of `iout_marl`."""

from trainers.group import Group, started_group
from trainers.ppo import Trainer
from trainers.run_folder import RunFolder
from trainers.train import DivergedError, TrainingOutcome, find_device, train
from trainers.trained import TrainedPolicy

__all__ = [
    "DivergedError",
    "Group",
    "RunFolder",
    "TrainedPolicy",
    "Trainer",
    "TrainingOutcome",
    "find_device",
    "started_group",
    "train",
]
