"""Training steps a second: this trainer beside Stable-Baselines3's PPO.

Both train on the same scenario from rollout to update, logs off. Stable-Baselines3 runs
on the joint Gymnasium environment at the paper's settings (8 environments, 100 slots and
minibatches of 100, 10 epochs); this trainer at the same settings, at its shorter and its default
preset, and in two processes that train one policy (one torch thread each; as their log tells, so
with logs and checkpoints). They take turns; the median is what counts, the ratio is to
Stable-Baselines3 in the same round. Every other subject runs with `--threads` torch threads.

Then what a whole `iout train` takes from the start of its process to its first update, and
the memory that it holds at most.

    python benchmarks/training.py [--scenario paper/k10-fdd] [--repeats 3] [--threads 1]
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import machine
import torch
from contestants import at_papers_settings

from iout_marl.scenario import load_scenario
from trainers import Trainer


def stable_baselines3(name: str, steps: int = 8_000) -> float:
    """Stable-Baselines3 at the paper's settings."""
    model = at_papers_settings(load_scenario(name), seed=0)
    started = time.perf_counter()
    model.learn(steps)
    return steps / (time.perf_counter() - started)


def this_trainer(preset: str, iterations: int) -> Callable[[str], float]:
    """This trainer at one of its presets."""

    def measure(name: str) -> float:
        trainer = Trainer(load_scenario(name, {"training.preset": preset}))
        trainer.iterate()  # the first one warms caches and allocators
        started = time.perf_counter()
        for _ in range(iterations):
            trainer.iterate()
        return iterations * trainer.steps_per_iteration / (time.perf_counter() - started)

    return measure


def two_processes(name: str, steps: int = 1_024_000) -> float:
    """This trainer in two processes on this machine."""
    launcher = ["-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]
    with tempfile.TemporaryDirectory() as folder:
        command = [*launcher, "-m", "trainers.ppo", name, "--out", folder, "--steps", str(steps)]
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        subprocess.run([sys.executable, *command], check=True, capture_output=True, env=environment)
        lines = (Path(folder) / "metrics.jsonl").read_text(encoding="utf-8").splitlines()
    return statistics.median(json.loads(line)["speed/env_steps_per_s"] for line in lines)


def whole_run(name: str) -> tuple[float, float]:
    """Seconds from the start of a process to its first update, and its memory at most in MB."""
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "iout_marl", "train", name, "--out", folder]
        with subprocess.Popen(
            [*command, "--steps", "512000"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        ) as process:
            metrics = Path(folder) / "metrics.jsonl"
            while not (metrics.is_file() and metrics.stat().st_size):
                time.sleep(0.01)
            seconds = time.perf_counter() - started
            process.wait()
    return seconds, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", default="paper/k10-fdd")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    reference = "Stable-Baselines3, paper's settings"
    subjects: dict[str, Callable[[str], float]] = {
        reference: stable_baselines3,
        "this trainer, paper's settings": this_trainer("paper", 10),
        "this trainer, preset short": this_trainer("short", 60),
        "this trainer, preset fast": this_trainer("fast", 20),
        "this trainer, preset fast, 2 processes": two_processes,
    }
    runs = [whole_run(options.scenario) for _ in range(options.repeats)]
    rates: dict[str, list[float]] = {name: [] for name in subjects}
    for _ in range(options.repeats):
        for name, measure in subjects.items():
            rates[name].append(measure(options.scenario))
    print(machine.describe())
    print(
        f"training steps a second, {options.scenario}, {options.threads} torch thread(s), "
        f"{options.repeats} rounds\n"
    )
    print(f"{'':38s}{'median':>10s}{'min':>10s}{'max':>10s}{'ratio':>8s}")
    for name, values in rates.items():
        ratio = statistics.median(v / s for v, s in zip(values, rates[reference], strict=True))
        row = (statistics.median(values), min(values), max(values))
        print(f"{name:38s}" + "".join(f"{v:10,.0f}" for v in row) + f"{ratio:8.1f}")
    seconds, memory = zip(*runs, strict=True)
    print(f"\niout train: {statistics.median(seconds):.2f} s to the first update ", end="")
    print(f"({min(seconds):.2f} to {max(seconds):.2f}), at most {max(memory):.0f} MB")


if __name__ == "__main__":
    main()
