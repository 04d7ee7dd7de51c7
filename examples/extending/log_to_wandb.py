"""A callback of one's own: logs a training to Weights & Biases, offline.

Nothing is sent and no account is needed; `wandb sync runs/wandb/offline-run-…` uploads it later.

    pip install wandb
    python examples/extending/log_to_wandb.py [--out runs/logged]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch
import wandb

from iout_marl import load_scenario, train
from trainers import Callback, TrainingRun


class WandbLog(Callback):
    """One Weights & Biases run for the first policy of a training.

    Args:
        project: what it is filed under.
        folder: where the offline run is written.
    """

    def __init__(self, project: str, folder: Path) -> None:
        self.project = project
        self.folder = folder

    def on_start(self, training: TrainingRun) -> None:
        """Begin a run, with the scenario as its configuration."""
        self.run = None
        if training.is_first:  # of several processes one logs
            scenario = training.trainer.scenario
            self.folder.mkdir(parents=True, exist_ok=True)
            self.run = wandb.init(
                project=self.project,
                name=f"{scenario.name}, seed {training.trainer.seeds[0]}",
                config={**scenario.model_dump(mode="json"), "hash": scenario.hash},
                dir=self.folder,
                mode="offline",
            )

    def on_iteration(self, training: TrainingRun) -> None:
        """Log what TensorBoard gets, by the same tags."""
        if self.run is not None:
            self.run.log(training.figures[0], step=training.trainer.env_steps)

    def on_end(self, training: TrainingRun) -> None:
        """Add the final evaluation and close the run; it counts as failed if the training did."""
        if self.run is None:
            return
        if training.evaluations:
            metrics = training.evaluations[0].metrics
            self.run.summary.update({f"final/{name}": each.mean for name, each in metrics.items()})
        self.run.finish(exit_code=0 if training.failure is None else 1)


def main(options: list[str] | None = None) -> None:
    """Train for a few seconds, and log it."""
    torch.set_num_threads(1)  # more cost time on networks of this size
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", default="runs/logged")
    parser.add_argument("--folder", type=Path, default="runs")
    given = parser.parse_args(options)
    scenario = load_scenario("paper/k3-fdd", {"training.steps": 100_000})
    log = WandbLog("iout", given.folder)
    train(scenario, given.out, callbacks=[log], evaluation_episodes=20)


if __name__ == "__main__":
    main()
