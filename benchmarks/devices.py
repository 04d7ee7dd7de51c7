"""From which batch size an accelerator pays: steps a second of world and training by device.

The world runs on NumPy and on torch on the CPU, and on torch on a CUDA device where there is
one, compiled, and compiled and recorded as a CUDA graph; training on each device. Replicas are
policies trained side by side in one batch. Without a CUDA device the table has the CPU's
columns alone, and says so. The defaults suit a processor; a large GPU takes more:

    python benchmarks/devices.py [--repeats 3] [--largest 65536]
    python benchmarks/devices.py --largest 4194304 --largest-training 65536 --most-policies 4096
"""

from __future__ import annotations

import argparse
import functools
import statistics
import time
from collections.abc import Callable
from typing import Any

import machine
import numpy as np
import torch

from iout_marl.scenario import load_scenario
from iout_marl.world import State, World, node_codes
from trainers import Trainer
from trainers.accel.graphs import GRAPHS, CapturedFunction, Graph, write_over

SCENARIO = "paper/k10-fdd"


def synchronise(device: str) -> None:
    """Wait for a device."""
    if device == "cuda":
        torch.cuda.synchronize()


def world_rate(
    library: Any, device: str, envs: int, slots: int = 100, *, recorded: bool = False
) -> float:
    """Environment steps a second, with reward and observation."""
    where = None if library is np else device
    world = World(load_scenario(SCENARIO), envs, library=library, dtype="float32", device=where)
    state = world.reset(node_codes(world.scenario, world.grid, [np.random.default_rng(0)] * envs))
    rng = np.random.default_rng(0)
    sizes = world.action_sizes
    draws = rng.random((8, envs, world.num_auvs, len(sizes)))
    actions = [world.backend.integers((draw * sizes).astype(np.int64)) for draw in draws]
    slot = torch.compile(world.slot, fullgraph=True) if device == "cuda" else world.slot
    if recorded:
        # A graph reads and writes the same memory each time, every field its own.
        slot = in_place(slot, state.map(torch.clone), GRAPHS[device](torch.device(device)))
    for action in actions[:2]:  # the second call records
        state, _, _ = slot(state, action)
    synchronise(device)
    started = time.perf_counter()
    for t in range(slots):
        state, _, _ = slot(state, actions[t % len(actions)])
    synchronise(device)
    return slots * envs / (time.perf_counter() - started)


def in_place(
    slot: Callable[[State, Any], tuple[State, Any, Any]], state: State, graph: Graph
) -> Callable[[State, Any], tuple[State, Any, Any]]:
    """The slot, recorded, on a state that stays where it is, whatever state comes in."""

    def play(action: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        after, reward, observation = slot(state, action)
        write_over(state, after)
        return reward, observation

    recorded = CapturedFunction(play, graph)
    return lambda _, action: (state, *recorded(action))


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


def powers(first: int, last: int) -> list[int]:
    """Powers of four, from one to another."""
    return [4**i for i in range(13) if first <= 4**i <= last]


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
    parser.add_argument("--largest-training", type=int, default=4096, help="environments of it")
    parser.add_argument("--most-policies", type=int, default=64, help="trained side by side")
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
    for device in set(devices) & set(GRAPHS):
        world[f"{device}, graph"] = functools.partial(world_rate, torch, device, recorded=True)
    table("world, by environments", powers(4, options.largest), world, options.repeats)
    training: dict[str, Callable[[int], float]] = {
        d: lambda envs, d=d: training_rate(d, envs) for d in devices
    }
    sizes = powers(4, options.largest_training)
    table("training, by environments", sizes, training, options.repeats)
    replicas: dict[str, Callable[[int], float]] = {
        d: lambda number, d=d: training_rate(d, 16, number) for d in devices
    }
    title = "training of policies side by side, 16 environments each, by policies"
    table(title, powers(1, options.most_policies), replicas, options.repeats)


if __name__ == "__main__":
    main()
