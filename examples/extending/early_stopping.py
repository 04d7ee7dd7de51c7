"""A callback of one's own: ends a training that no longer gets better.

python examples/extending/early_stopping.py [--out runs/early-stopping]
"""

from __future__ import annotations

import argparse
import math

import torch

from iout_marl import load_scenario, train
from trainers import Callback, TrainingRun


class EarlyStopping(Callback):
    """Stops once the sampled mean AoI of the first policy has not fallen for a while.

    Args:
        patience: iterations with a finished episode that may pass without a new best.
        least_gain: by how much, in slots, a best must be better than the one before.
    """

    def __init__(self, patience: int = 3, least_gain: float = 0.1) -> None:
        self.patience = patience
        self.least_gain = least_gain

    def on_start(self, training: TrainingRun) -> None:
        """Begin to count."""
        self.best, self.waited = math.inf, 0

    def on_iteration(self, training: TrainingRun) -> None:
        """Look at what was logged."""
        mean_aoi = training.figures[0].get("aoi/mean")
        if mean_aoi is None:  # no episode has ended in this rollout
            return
        if mean_aoi < self.best - self.least_gain:
            self.best, self.waited = mean_aoi, 0
        else:
            self.waited += 1
        if self.waited >= self.patience:
            training.stop()


def main(options: list[str] | None = None) -> tuple[int, float]:
    """Environment steps that were taken, and the mean AoI of the final evaluation."""
    torch.set_num_threads(1)  # more cost time on networks of this size
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", default="runs/early-stopping")
    out = parser.parse_args(options).out
    scenario = load_scenario("paper/k3-fdd", {"training.steps": 1_000_000})
    outcome = train(scenario, out, callbacks=[EarlyStopping()], evaluation_episodes=20)
    steps, mean_aoi = outcome.trainer.env_steps, outcome.evaluation.metrics["mean_aoi"].mean
    print(f"{steps:,} of 1,000,000 steps, mean AoI {mean_aoi:.2f}")
    return steps, mean_aoi


if __name__ == "__main__":
    main()
