"""Environment steps a second, side by side: single, SuperSuit × 16, batched.

A step is one slot of one environment with its action drawn beforehand, and includes
reward, observation and infos of the face. Each subject runs `--repeats` times in turn;
the median is what counts, the ratio is to the single ParallelEnv of the same round.

    python benchmarks/environment.py [--scenario paper/k10-fdd] [--repeats 5]
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import statistics
import time
from collections.abc import Callable

import machine
import numpy as np
import supersuit
import torch

from iout_marl import iout_v0
from iout_marl.envs import AUVVectorEnv
from iout_marl.scenario import load_scenario
from iout_marl.world import World, node_codes


def _actions(sizes: tuple[int, ...], count: int, *shape: int) -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    return [np.stack([rng.integers(0, n, shape) for n in sizes], axis=-1) for _ in range(count)]


def single(scenario: str, episodes: int = 20) -> float:
    """One ParallelEnv."""
    env = iout_v0.parallel_env(scenario)
    env.reset(seed=0)
    slots = env.scenario.num_slots
    sizes = tuple(env.action_space("auv_0").nvec)
    actions = [{"auv_0": a} for a in _actions(sizes, slots)]
    started = time.perf_counter()
    for _ in range(episodes):
        env.reset()
        for action in actions:
            env.step(action)
    return episodes * slots / (time.perf_counter() - started)


def supersuit_copies(scenario: str, copies: int = 16, episodes: int = 2) -> float:
    """Copies of the ParallelEnv through SuperSuit, in one process."""
    env = iout_v0.parallel_env(scenario)
    slots = env.scenario.num_slots
    sizes = tuple(env.action_space("auv_0").nvec)
    vec = supersuit.concat_vec_envs_v1(
        supersuit.pettingzoo_env_to_vec_env_v1(env), copies, num_cpus=0, base_class="gymnasium"
    )
    vec.reset(seed=0)
    actions = _actions(sizes, slots, copies)
    started = time.perf_counter()
    for _ in range(episodes):
        for action in actions:
            vec.step(action)
    return episodes * slots * copies / (time.perf_counter() - started)


def vector_env(scenario: str, copies: int = 4096, episodes: int = 1) -> float:
    """The batched Gymnasium face, float64."""
    env = AUVVectorEnv(scenario, copies)
    slots = env.scenario.num_slots
    actions = _actions(tuple(env.single_action_space.nvec), slots, copies)
    env.reset(seed=0)
    started = time.perf_counter()
    for _ in range(episodes):
        for action in actions:
            env.step(action)
    return episodes * slots * copies / (time.perf_counter() - started)


def batched_world(library: object, copies: int = 4096) -> Callable[[str], float]:
    """The batched world with reward and observation, float32, as the trainer runs it."""

    def measure(name: str) -> float:
        scenario = load_scenario(name)
        world = World(scenario, copies, library=library, dtype="float32")
        rngs = [np.random.default_rng(0)] * copies
        state = world.reset(node_codes(scenario, world.grid, rngs))
        actions = [
            world.backend.integers(a)
            for a in _actions(world.action_sizes, world.num_slots, copies, world.num_auvs)
        ]
        started = time.perf_counter()
        for action in actions:
            state, events = world.step(state, action)
            world.reward(state, events)
            world.observe(state)
        return world.num_slots * copies / (time.perf_counter() - started)

    return measure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", default="paper/k10-fdd")
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    torch.set_num_threads(1)
    subjects: dict[str, Callable[[str], float]] = {
        "ParallelEnv": single,
        "SuperSuit x 16": supersuit_copies,
        "VectorEnv x 4096": vector_env,
        "World x 4096, NumPy": batched_world(np),
        "World x 4096, torch": batched_world(torch),
    }
    rates: dict[str, list[float]] = {name: [] for name in subjects}
    for _ in range(options.repeats):
        for name, measure in subjects.items():
            rates[name].append(measure(options.scenario))
    print(machine.describe())
    print(f"environment steps a second, {options.scenario}, one core, {options.repeats} rounds\n")
    print(f"{'':22s}{'median':>12s}{'min':>12s}{'max':>12s}{'ratio':>9s}")
    for name, values in rates.items():
        ratio = statistics.median(v / s for v, s in zip(values, rates["ParallelEnv"], strict=True))
        row = (statistics.median(values), min(values), max(values))
        print(f"{name:22s}" + "".join(f"{v:12,.0f}" for v in row) + f"{ratio:9.1f}")


if __name__ == "__main__":
    main()
