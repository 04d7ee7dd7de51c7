"""Compiled slots beside the same on NumPy, and what compiling them takes.

For the paper's world of ten nodes, three AUVs in it and the sea of `sea.py`: the bare world
(float32, with reward and observation, chance drawn beforehand), VectorEnv, and training. Both kinds
take turns in one process; rates are by processor time, a ratio is the median over rounds of those
within a round.

    python benchmarks/compiled.py [--repeats 5] [--environments 16 1024 4096]
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import statistics
import tempfile
import time
import warnings
from collections.abc import Callable

import machine
import numpy as np
import torch
from sea import PAPER, bare, sea, training, vector_env

from iout_marl.compiled import module
from iout_marl.compiled.choice import VARIABLE
from iout_marl.compiled.slot import CompiledSlot
from iout_marl.scenario import Scenario, load_scenario
from iout_marl.world import World, node_codes

AUVS = "multi/m3-k10-fdd"


def compiled_world(scenario: Scenario, envs: int) -> Callable[[], float]:
    """`sea.bare`, compiled."""
    world = World(scenario, envs, dtype="float32")
    slot = CompiledSlot(scenario, "float32", with_events=False, summed=world.summed)
    rng = np.random.default_rng(0)
    codes = node_codes(scenario, world.grid, [rng] * envs)
    shape, stream = (envs, world.num_auvs), world.draw_chance(0)
    actions = [
        np.stack([rng.integers(0, n, shape) for n in world.action_sizes], -1)
        for _ in range(world.num_slots)
    ]
    beforehand = [next(stream) for _ in actions]
    slot.compile()

    def measure() -> float:
        columns = slot.columns(world.reset(codes))
        started = time.process_time()
        for action, chance in zip(actions, beforehand, strict=True):
            columns = slot(columns, action, chance).columns
        return len(actions) * envs / (time.process_time() - started)

    return measure


def played(when: str, make: Callable[[], Callable[[], float]]) -> Callable[[], float]:
    """What `make` makes while the environment variable says when slots are compiled."""
    os.environ[VARIABLE] = when
    try:
        return make()
    finally:
        del os.environ[VARIABLE]


def print_compile_times(scenarios: dict[str, Scenario]) -> None:
    """Seconds to write a slot down, to compile it, and to read it where it is kept."""
    print(f"{'seconds':32s}{'written':>12s}{'compiled':>12s}{'read again':>12s}")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder
        for name, scenario in scenarios.items():
            times = [time.perf_counter()]
            slot = CompiledSlot(scenario, observed="float32")
            times.append(time.perf_counter())
            for _ in range(2):
                module.loaded_function.cache_clear()
                slot.compile()
                times.append(time.perf_counter())
            print(f"{name:32s}" + "".join(f"{s:12.2f}" for s in np.diff(times)))
        del os.environ["XDG_CACHE_HOME"]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--environments", type=int, nargs="+", default=[16, 1024, 4096])
    options = parser.parse_args()
    torch.set_num_threads(1)
    # What a plausible sea says of itself is not the question here.
    warnings.simplefilter("ignore")
    scenarios = {PAPER: load_scenario(PAPER), AUVS: load_scenario(AUVS), "sea": sea()}
    print(machine.describe())
    print_compile_times(scenarios)
    subjects: dict[str, tuple[Callable[[], float], Callable[[], float]]] = {}
    for name, scenario in scenarios.items():
        subjects[f"{name}, World x 4096"] = (
            bare(scenario, 4096, on_the_way=False),
            compiled_world(scenario, 4096),
        )
        for envs in options.environments:
            pair = [
                played(when, lambda s=scenario, n=envs: vector_env(s, n))
                for when in ("never", "always")
            ]
            subjects[f"{name}, VectorEnv x {envs}"] = (pair[0], pair[1])
        pair = [played(when, lambda s=scenario: training(s)) for when in ("never", "always")]
        subjects[f"{name}, training"] = (pair[0], pair[1])
    rates: dict[str, list[tuple[float, float]]] = {name: [] for name in subjects}
    for _ in range(options.repeats):
        for name, (first, second) in subjects.items():
            rates[name].append((first(), second()))
    print(f"\nsteps a second of processor time, {options.repeats} rounds")
    print(f"{'':32s}{'NumPy':>12s}{'compiled':>12s}{'ratio':>8s}{'min':>7s}{'max':>7s}")
    for name, pairs in rates.items():
        own, others = (statistics.median(column) for column in zip(*pairs, strict=True))
        ratios = [other / one for one, other in pairs]
        print(f"{name:32s}{own:12,.0f}{others:12,.0f}", end="")
        print(f"{statistics.median(ratios):8.2f}{min(ratios):7.2f}{max(ratios):7.2f}")


if __name__ == "__main__":
    main()
