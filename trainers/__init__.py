"""PPO in plain torch on the batched world of `iout_marl`."""

from trainers.ppo import Trainer
from trainers.run_folder import RunFolder
from trainers.train import TrainingOutcome, find_device, train
from trainers.trained import TrainedPolicy

__all__ = [
    "RunFolder",
    "TrainedPolicy",
    "Trainer",
    "TrainingOutcome",
    "find_device",
    "train",
]
