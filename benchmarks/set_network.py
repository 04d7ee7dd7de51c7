"""Smaller set networks: what a training step costs, and what that costs in quality.

Each variant of `training.network: set` learns on layouts of ten nodes that are drawn anew for every
episode, for as many steps as the others, and then plays layouts that it has not seen by its most
probable actions: mean AoI, with the half-width of its 95 % interval over layouts, seeds one after
the other. MFLOP are those of matrix products of an environment step: choosing an action, the value,
and both passes of every epoch. `--nodes` measures what a step costs per AUV-node pair as networks
grow. Speed is by processor time, in one thread.

    python benchmarks/set_network.py [--steps 2e6] [--seeds 1] [--layouts 200]
    python benchmarks/set_network.py --nodes 10 30 100 300 1000
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import math
import statistics
import time
from typing import Any

import machine
import numpy as np
import torch
from torch.utils.flop_counter import FlopCounterMode

from iout_marl import evaluate
from iout_marl.scenario import Scenario, load_scenario
from trainers import Trainer

_SMALL = {"heads": 0, "pair_width": 4, "width": 16, "critic_width": 16, "critic_blocks": 0}
#: By name: settings of the network, environments and minibatches.
VARIANTS: dict[str, tuple[dict[str, Any], int, int]] = {
    "default": ({}, 128, 16),
    "without attention": ({"heads": 0}, 128, 16),
    "one round of 24": (
        {**_SMALL, "width": 24, "blocks": 1, "pair_width": 6, "critic_blocks": 1},
        256,
        16,
    ),
    "one round of 16": ({**_SMALL, "blocks": 1}, 512, 16),
    "no round, 16": ({**_SMALL, "blocks": 0}, 512, 16),
}
#: AUV-node pairs that a rollout's slot has, where nodes grow.
PAIRS = 1280
#: The layouts that are played are drawn by seeds from here on, those of trainings by others.
FIRST_SEED = 1_000_000


def scenario(variant: str, nodes: int, steps: float, **training: Any) -> Scenario:
    """Layouts that are drawn anew for every episode."""
    network, environments, minibatches = VARIANTS[variant]
    settings = {
        "preset": "pretrain",
        "steps": int(steps),
        "network": {"kind": "set", **network},
        "environments": environments,
        "minibatches": minibatches,
        **training,
    }
    return load_scenario(
        "random/k10-fdd",
        {
            "nodes": {"kind": "random", "count": nodes, "redraw": "episode"},
            "grid.cells": [10, 10, 4] if nodes <= 100 else [20, 20, 5],
            "observation": {"kind": "table"},
            **{f"training.{name}": value for name, value in settings.items()},
        },
    )


def mflop(trainer: Trainer) -> float:
    """Of an iteration, by environment step."""
    with FlopCounterMode(display=False) as counter:
        trainer.iterate()
    return counter.get_total_flops() / trainer.steps_per_iteration / 1e6


def quality(options: argparse.Namespace) -> None:
    """Print the table of variants."""
    print(f"{'':20}{'weights':>9}{'MFLOP':>8}{'steps/s':>10}{'ratio':>7}{'mean AoI':>10}{'±':>7}")
    first = None
    for name in VARIANTS:
        flops = mflop(Trainer(scenario(name, 10, options.steps)))
        rates, ages = [], []
        for seed in range(options.seeds):
            trainer = Trainer(scenario(name, 10, options.steps), seed=seed)
            started = time.process_time()
            while not trainer.finished:
                trainer.iterate()
            rates.append(trainer.env_steps / (time.process_time() - started))
            played = evaluate(trainer.source, trainer.policy(), options.layouts, FIRST_SEED)
            ages.append(played.samples["mean_aoi"])
        rate, by_layout = statistics.median(rates), np.mean(ages, axis=0)
        first = first or rate
        weights = sum(p.numel() for p in trainer.network.parameters())
        margin = 1.96 * by_layout.std(ddof=1) / math.sqrt(len(by_layout))
        print(
            f"{name:20}{weights:>9,}{flops:>8.2f}{rate:>10,.0f}{rate / first:>7.2f}"
            f"{by_layout.mean():>10.3f}{margin:>7.3f}",
            flush=True,
        )


def growth(options: argparse.Namespace) -> None:
    """Print what a step costs as networks grow."""
    print(f"{'µs by pair, K =':20}" + "".join(f"{nodes:>9,}" for nodes in options.nodes))
    for name in VARIANTS:
        line = f"{name:20}"
        for nodes in options.nodes:
            sizes = {"environments": max(PAIRS // nodes, 2), "minibatches": 2}
            trainer = Trainer(scenario(name, nodes, 1e9, **sizes))
            trainer.iterate()
            times = []
            for _ in range(3):
                started = time.process_time()
                trainer.iterate()
                times.append(time.process_time() - started)
            pairs = trainer.steps_per_iteration * nodes
            line += f"{statistics.median(times) / pairs * 1e6:>9.2f}"
        print(line, flush=True)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=float, default=2e6)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--layouts", type=int, default=200)
    parser.add_argument("--nodes", type=int, nargs="+")
    options = parser.parse_args()
    torch.set_num_threads(1)
    print(machine.describe() + "\n")
    (growth if options.nodes else quality)(options)


if __name__ == "__main__":
    main()
