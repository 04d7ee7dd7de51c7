"""From which batch size an accelerator pays: steps a second of world and training by device.

The world runs on NumPy and on torch on the CPU, and on torch on a CUDA device where there is
one; training on each device. Replicas are policies trained side by side in one batch.
Without a CUDA device the table has the CPU's columns alone, and says so.

    python benchmarks/devices.py [--repeats 3] [--largest 65536]
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from typing import Any

import machine
import numpy as np
import torch

from iout_marl.scenario import load_scenario
from iout_marl.world import World, node_codes
from trainers import Trainer

SCENARIO = "paper/k10-fdd"


def synchronise(device: str) -> None:
    """Wait for a device."""
    if device == "cuda":
        torch.cuda.synchronize()


def world_rate(library: Any, device: str, envs: int, slots: int = 100) -> float:
    """Environment steps a second, with reward and observation."""
    where = None if library is np else device
    world = World(load_scenario(SCENARIO), envs, library=library, dtype="float32", device=where)
    state = world.reset(node_codes(world.scenario, world.grid, [np.random.default_rng(0)] * envs))
    rng = np.random.default_rng(0)
    sizes = world.action_sizes
    draws = rng.random((8, envs, world.num_auvs, len(sizes)))
    actions = [world.backend.integers((draw * sizes).astype(np.int64)) for draw in draws]
    slot = torch.compile(world.slot, fullgraph=True) if device == "cuda" else world.slot
    state, _, _ = slot(state, actions[0])
    synchronise(device)
    started = time.perf_counter()
    for t in range(1, slots):
        state, _, _ = slot(state, actions[t % len(actions)])
    synchronise(device)
    return (slots - 1) * envs / (time.perf_counter() - started)


def training_rate(device: str, envs: int, replicas: int = 1) -> float:
    """Training steps a second, of all policies together."""
    trainer = Trainer(
        load_scenario(SCENARIO, {"training.environments": envs}), device=device, replicas=replicas
    )
    for _ in range(2):  # the second records CUDA graphs
        trainer.iterate_all()
    synchronise(device)
    started = time.perf_counter()
    trainer.iterate_all()
    synchronise(device)
    return replicas * trainer.steps_per_iteration / (time.perf_counter() - started)


def table(
    title: str, rows: list[int], columns: dict[str, Callable[[int], float]], repeats: int
) -> None:
    """Medians in thousands of steps a second."""
    print(f"\n{title}, thousand steps a second\n")
    print(f"{'':>8s}" + "".join(f"{name:>14s}" for name in columns))
    for row in rows:
        medians = [
            statistics.median(measure(row) for _ in range(repeats)) for measure in columns.values()
        ]
        print(f"{row:8,d}" + "".join(f"{value / 1e3:14,.0f}" for value in medians), flush=True)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--largest", type=int, default=65_536, help="environments of the world")
    options = parser.parse_args()
    torch.set_num_threads(1)
    print(machine.describe())
    has_gpu = torch.cuda.is_available()
    print(f"CUDA device: {torch.cuda.get_device_name() if has_gpu else 'none here'}")
    devices = ["cpu", "cuda"] if has_gpu else ["cpu"]
    world: dict[str, Callable[[int], float]] = {
        "NumPy": lambda envs: world_rate(np, "cpu", envs),
        **{f"torch, {d}": lambda envs, d=d: world_rate(torch, d, envs) for d in devices},
    }
    batches = [4**i for i in range(1, 13) if 4**i <= options.largest]
    table("world, by environments", batches, world, options.repeats)
    training: dict[str, Callable[[int], float]] = {
        d: lambda envs, d=d: training_rate(d, envs) for d in devices
    }
    table("training, by environments", [b for b in batches if b <= 4096], training, options.repeats)
    replicas: dict[str, Callable[[int], float]] = {
        d: lambda number, d=d: training_rate(d, 16, number) for d in devices
    }
    title = "training of policies side by side, 16 environments each, by policies"
    table(title, [1, 4, 16, 64], replicas, options.repeats)


if __name__ == "__main__":
    main()
