"""What the default preset learns: deterministic policies beside the greedy baseline.

Trains every scenario with several seeds, evaluates each policy (one episode: the
scenarios and the policies are deterministic) and prints mean AoI, energy, fairness and
the wall-clock seconds of a training. A line is printed as soon as a scenario is done.

    python benchmarks/quality.py [SCENARIO …] [--seeds 3] [--threads 1]
"""

from __future__ import annotations

import argparse
import statistics
import time

import machine
import torch

from iout_marl.evaluation import evaluate
from iout_marl.scenario import bundled_names, load_scenario
from trainers import TrainedPolicy, Trainer


def train(name: str, seed: int) -> dict[str, float]:
    """Train once; the metrics of the policy, and the seconds that it took."""
    started = time.perf_counter()
    trainer = Trainer(load_scenario(name), seed)
    while not trainer.finished:
        trainer.iterate()
    seconds = time.perf_counter() - started
    policy = TrainedPolicy(trainer.network, use_mask=trainer.settings.mask_actions)
    metrics = evaluate(trainer.scenario, policy, episodes=1).metrics
    return {**{key: estimate.mean for key, estimate in metrics.items()}, "seconds": seconds}


def spread(values: list[float], digits: int) -> str:
    """Mean, and the range over seeds."""
    low, mean, high = (f"{f(values):.{digits}f}" for f in (min, statistics.mean, max))
    return f"{mean} ({low} to {high})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenarios", nargs="*", default=bundled_names())
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    print(machine.describe())
    print(f"default preset, {options.seeds} seeds: mean (range); greedy: 100 episodes\n")
    print(
        "| scenario | mean AoI | harvested kJ | Jain | seconds | greedy AoI |\n"
        "|---|---|---|---|---|---|"
    )
    for name in options.scenarios:
        runs = [train(name, seed) for seed in range(options.seeds)]
        greedy = evaluate(name, "greedy").metrics["mean_aoi"].mean
        columns = (("mean_aoi", 2), ("harvested_kj", 2), ("jain", 3), ("seconds", 0))
        cells = [spread([run[key] for run in runs], digits) for key, digits in columns]
        print(f"| {name} | {' | '.join(cells)} | {greedy:.2f} |", flush=True)


if __name__ == "__main__":
    main()
