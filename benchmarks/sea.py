"""What a sea with everything switched on costs: steps a second beside the paper's world.

Two worlds of one AUV and ten nodes on the paper's grid take turns in one process:
`paper/k10-fdd`, and the same with a battery, a capacitor, modems, polling, a tide, shadowing,
wind and bit errors. Both run bare (with reward and observation, float32, as the trainer runs
them; what is left to chance drawn beforehand, and on the way), as VectorEnv, and in training.
Rates are by processor time; a ratio is the median over rounds of those within a round.

    python benchmarks/sea.py [--repeats 5] [--environments 1 16 64 256 1024] [--no-training]
    python benchmarks/sea.py --without polling shadowing
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import statistics
import time
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import machine
import numpy as np
import torch

from iout_marl.envs import AUVVectorEnv
from iout_marl.scenario import Scenario, load_scenario
from iout_marl.world import World, node_codes
from trainers import Trainer

PAPER = "paper/k10-fdd"
#: What each aspect of the sea changes, one after the other.
ASPECTS: dict[str, dict[str, Any]] = {
    "modem": {
        "channel": {"kind": "sonar", "spreading_factor": 1.5, "wind_m_per_s": 6.0},
        "harvester": {"kind": "aperture", "area_m2": 0.5, "efficiency": 0.5, "threshold_w": 1e-3},
        "uplink": {
            "kind": "modem",
            "bit_rate_bps": 2000.0,
            "packet_bits": 2048.0,
            "bandwidth_hz": 3000.0,
            "electronics_w": 0.5,
            "maximum_source_level_db": 165.0,
            "required_snr_db": 8.0,
        },
    },
    "capacitor": {
        "storage": {"kind": "capacitor", "capacity_j": 50.0, "leakage_w": 1e-4, "idle_w": 1e-3}
    },
    "battery": {
        "vehicle": {
            "kind": "battery",
            "capacity_j": 14.4e6,
            "drag_area_m2": 3.0,
            "drag_coefficient": 0.006,
            "propulsion_efficiency": 0.7,
            "hotel_w": 40.0,
            "max_speed_m_per_s": 4.2,
        }
    },
    "tide": {"current": {"kind": "tide", "speed_m_per_s": 0.3, "toward_deg": 30.0}},
    "shadowing": {
        "channel.fading": {"kind": "shadowing", "sigma_db": 3.0, "coherence_s": 300.0},
    },
    "losses": {"uplink.loss": "bpsk"},
    "wind": {"channel.wind": {"kind": "gauss_markov", "sigma_m_per_s": 2.0, "coherence_s": 3600.0}},
    "polling": {"hearing": {"kind": "polling", "max_nodes_per_slot": 3}},
}


def sea(without: Sequence[str] = ()) -> Scenario:
    """The scenario with all aspects but some."""
    changed: dict[str, Any] = {}
    for name, keys in ASPECTS.items():
        if name not in without:
            changed |= keys
    return load_scenario(PAPER, changed)


def bare(scenario: Scenario, envs: int, *, on_the_way: bool) -> Callable[[], float]:
    """The world on NumPy, whose chance is drawn beforehand or as the slots come."""
    world = World(scenario, envs, dtype="float32")
    rng = np.random.default_rng(0)
    codes = node_codes(scenario, world.grid, [rng] * envs)
    shape, slots = (envs, world.num_auvs), scenario.num_slots
    actions = [
        world.backend.integers(
            np.stack([rng.integers(0, n, shape) for n in world.action_sizes], -1)
        )
        for _ in range(slots)
    ]
    stream = world.draw_chance(0)
    beforehand = None if on_the_way else [next(stream) for _ in range(slots)]

    def measure() -> float:
        state = world.reset(codes)
        chance = stream if beforehand is None else iter(beforehand)
        started = time.process_time()
        for action in actions:
            state, _reward, _observation = world.slot(state, action, next(chance))
        return slots * envs / (time.process_time() - started)

    return measure


def vector_env(scenario: Scenario, envs: int) -> Callable[[], float]:
    """The batched Gymnasium API."""
    env, rng = AUVVectorEnv(scenario, envs), np.random.default_rng(0)
    sizes, slots = env.single_action_space.nvec, scenario.num_slots
    actions = [np.stack([rng.integers(0, n, envs) for n in sizes], axis=-1) for _ in range(slots)]
    episodes = max(1, 64 // envs)

    def measure() -> float:
        env.reset(seed=0)
        started = time.process_time()
        for _ in range(episodes):
            for action in actions:
                env.step(action)
        return episodes * slots * envs / (time.process_time() - started)

    return measure


def training(scenario: Scenario) -> Callable[[], float]:
    """The trainer at its default preset."""
    trainer = Trainer(scenario)
    trainer.iterate()  # the first one warms caches and allocators

    def measure() -> float:
        started = time.process_time()
        for _ in range(5):
            trainer.iterate()
        return 5 * trainer.steps_per_iteration / (time.process_time() - started)

    return measure


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--environments", type=int, nargs="+", default=[1, 16, 64, 256, 1024])
    parser.add_argument("--without", nargs="+", choices=list(ASPECTS)[1:], default=[])
    parser.add_argument("--no-training", action="store_true")
    options = parser.parse_args()
    torch.set_num_threads(1)
    # What a plausible sea says of itself is not the question here.
    warnings.simplefilter("ignore")
    paper, rough = load_scenario(PAPER), sea(options.without)
    calm = bare(paper, 1024, on_the_way=False)
    subjects: dict[str, tuple[Callable[[], float], Callable[[], float]]] = {
        "World x 1024": (calm, bare(rough, 1024, on_the_way=False)),
        "World x 1024, drawn on the way": (calm, bare(rough, 1024, on_the_way=True)),
    }
    for envs in options.environments:
        subjects[f"VectorEnv x {envs}"] = (vector_env(paper, envs), vector_env(rough, envs))
    if not options.no_training:
        subjects["training, preset fast"] = (training(paper), training(rough))
    rates: dict[str, list[tuple[float, float]]] = {name: [] for name in subjects}
    for _ in range(options.repeats):
        for name, (first, second) in subjects.items():
            rates[name].append((first(), second()))
    print(machine.describe())
    left_out = f" without {', '.join(options.without)}" if options.without else ""
    print(f"steps a second of processor time, {options.repeats} rounds, the sea{left_out}\n")
    print(f"{'':32s}{PAPER:>16s}{'sea':>12s}{'ratio':>8s}{'min':>7s}{'max':>7s}")
    for name, pairs in rates.items():
        own, others = zip(*pairs, strict=True)
        ratios = [other / one for one, other in pairs]
        print(
            f"{name:32s}{statistics.median(own):16,.0f}{statistics.median(others):12,.0f}", end=""
        )
        print(f"{statistics.median(ratios):8.2f}{min(ratios):7.2f}{max(ratios):7.2f}")


if __name__ == "__main__":
    main()
