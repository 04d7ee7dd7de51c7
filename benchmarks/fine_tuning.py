"""What two minutes of fine-tuning come to on one scenario, beside PPO from the beginning.

For each scenario and seed: the policy that comes with the package as it is; the same after
`iout train SCENARIO --from pretrained`; and `iout train SCENARIO --steps 10e6`, the preset of the
scenario for longer. Mean AoI of the most probable actions, means over seeds with the lowest and the
highest, and seconds of processor time of a whole training, in one thread.

    python benchmarks/fine_tuning.py [--scenarios best/k10-fdd …] [--seeds 3]
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import machine
import numpy as np
import torch

from iout_marl import evaluate

SCENARIOS = [f"best/k{nodes}-{duplex}" for duplex in ("fdd", "tdd") for nodes in (3, 5, 7, 10)]
METHODS = {"fine-tuned": ["--from", "pretrained"], "PPO": ["--steps", "10e6"]}


def mean_aoi(scenario: str, policy: str) -> float:
    """That of the episode that a policy plays."""
    return float(evaluate(scenario, policy, 1).samples["mean_aoi"][0])


def trained(scenario: str, seed: int, words: list[str]) -> tuple[float, float]:
    """Mean AoI of a training's policy, and the seconds that the training took."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        command = [sys.executable, "-m", "iout_marl", "train", scenario, "--out", str(run)]
        subprocess.run(
            [*command, "--seed", str(seed), *words],
            check=True,
            capture_output=True,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        return mean_aoi(scenario, str(run)), seconds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenarios", nargs="+", default=SCENARIOS)
    parser.add_argument("--seeds", type=int, default=3)
    options = parser.parse_args()
    torch.set_num_threads(1)
    print(machine.describe())
    print(f"\n{'mean AoI':14}{'pretrained':>11}", end="")
    print("".join(f"{f'{name}, {options.seeds} seeds':>26}{'s':>6}" for name in METHODS))
    for scenario in options.scenarios:
        print(f"{scenario:14}{mean_aoi(scenario, 'pretrained'):11.3f}", end="", flush=True)
        for words in METHODS.values():
            found = np.array([trained(scenario, seed, words) for seed in range(options.seeds)])
            ages, seconds = found.T
            spread = f"{ages.mean():.3f} ({ages.min():.3f} to {ages.max():.3f})"
            print(f"{spread:>26}{np.median(seconds):6.0f}", end="", flush=True)
        print(flush=True)


if __name__ == "__main__":
    main()
