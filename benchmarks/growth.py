"""What a step costs as teams and networks grow: M AUVs, K nodes.

A row is a team and a network, drawn at random in a grid of 2000 cells, on one band
(`channel.access: interference`). `world` is the time of one slot of one environment in the
batched world, with reward and observation; `training` that of one environment step of a
training, masks included. The batch shrinks as M·K grows, so that all rows work on
arrays of like size. Rows are measured in turn, `--repeats` times; the median counts, and
beside it stands the spread, (highest − lowest)/median.

    python benchmarks/growth.py [--repeats 3] [--out FILE.csv]
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import csv
import statistics
import time
from pathlib import Path

import machine
import numpy as np
import torch

from iout_marl.scenario import Scenario, load_scenario
from iout_marl.world import World, node_codes
from trainers import Trainer

AUVS = (1, 2, 4, 8, 16, 32)
NODES = (10, 100, 1000)
#: AUV-node pairs in a batch.
PAIRS = 64_000


def scenario(auvs: int, nodes: int) -> Scenario:
    """A team and a network."""
    return load_scenario(
        "multi/m4-k10-fdd",
        {
            "grid.cells": [20, 20, 5],
            "nodes": {"kind": "random", "count": nodes, "redraw": "run"},
            "auvs.count": auvs,
        },
    )


def world_us(auvs: int, nodes: int, slots: int = 20) -> float:
    """µs of one slot of one environment."""
    envs = max(PAIRS // (auvs * nodes), 2)
    world = World(scenario(auvs, nodes), envs, dtype="float32")
    rng = np.random.default_rng(0)
    state = world.reset(node_codes(world.scenario, world.grid, [rng] * envs))
    shape = (1 + slots, envs, auvs)
    actions = np.stack([rng.integers(0, n, shape) for n in world.action_sizes], axis=-1)
    started = time.perf_counter()
    for slot, action in enumerate(actions):
        if slot == 1:  # the first one warms up
            started = time.perf_counter()
        state, events = world.step(state, action)
        world.reward(state, events)
        world.observe(state)
    return (time.perf_counter() - started) / (slots * envs) * 1e6


def training_us(auvs: int, nodes: int) -> float:
    """µs of one environment step of training."""
    envs = max(PAIRS // (auvs * nodes), 2)
    settings = {"training.environments": envs, "training.rollout_slots": 10}
    trainer = Trainer(load_scenario(scenario(auvs, nodes), settings))
    trainer.iterate()
    started = time.perf_counter()
    trainer.iterate()
    return (time.perf_counter() - started) / trainer.steps_per_iteration * 1e6


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--out", type=Path, help="write the table as CSV too")
    options = parser.parse_args()
    torch.set_num_threads(1)
    cases = [(auvs, nodes) for nodes in NODES for auvs in AUVS]
    measures = {"world": world_us, "training": training_us}
    times: dict[tuple[str, int, int], list[float]] = {}
    for _ in range(options.repeats):
        for name, measure in measures.items():
            for case in cases:
                times.setdefault((name, *case), []).append(measure(*case))
    print(machine.describe())
    print(
        f"{'M':>3} {'K':>5}"
        + "".join(f" {name + ' µs':>12} {'ns/pair':>8} {'±':>5}" for name in measures)
    )
    rows = []
    for auvs, nodes in cases:
        row: dict[str, float] = {"auvs": auvs, "nodes": nodes}
        line = f"{auvs:>3} {nodes:>5}"
        for name in measures:
            values = times[name, auvs, nodes]
            median = statistics.median(values)
            spread = (max(values) - min(values)) / median
            pair_ns = 1000 * median / (auvs * nodes)
            row |= {f"{name}_us": round(median, 2), f"{name}_ns_per_pair": round(pair_ns, 2)}
            line += f" {median:>12.1f} {pair_ns:>8.1f} {spread:>4.0%} "
        rows.append(row)
        print(line)
    if options.out:
        with options.out.open("w", newline="") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)


if __name__ == "__main__":
    main()
