"""Environment steps a second, side by side: single, for Stable-Baselines3, batched, others' own.

A step is one slot of one environment with its action drawn beforehand, and includes
reward, observation and infos of the API. Each subject runs `--repeats` times in turn;
the median is what counts, the ratio is to the single ParallelEnv of the same round.

Beside them stand environments of other projects that come nearest in size, with as many
agents as the name says: of PettingZoo the pursuit of 10 evaders on a grid of 10 × 10 cells,
the particles of MPE (as many landmarks as agents), and those of VMAS in a batch. They
simulate something else: what is compared is how fast a learner gets on. The packages of
`pip install -e '.[bench]'` are needed for them; a subject that cannot run here is
named, with the reason, and left out.

    python benchmarks/environment.py [--scenario paper/k10-fdd] [--repeats 5]
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import functools
import importlib.util
import shutil
import statistics
import sys
import time
import warnings
from collections.abc import Callable
from typing import Any

import machine
import numpy as np
import torch

from iout_marl import iout_v0
from iout_marl.envs import AUVVectorEnv, sb3_vec_env, supersuit_vec_env
from iout_marl.scenario import load_scenario
from iout_marl.world import World, node_codes


def _actions(sizes: tuple[int, ...], count: int, *shape: int) -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    return [np.stack([rng.integers(0, n, shape) for n in sizes], axis=-1) for _ in range(count)]


def single(scenario: str, episodes: int = 20) -> float:
    """One ParallelEnv."""
    env = iout_v0.parallel_env(scenario)
    env.reset(seed=0)
    slots, agents = env.scenario.num_slots, env.possible_agents
    sizes = tuple(env.action_space(agents[0]).nvec)
    actions = [dict(zip(agents, rows, strict=True)) for rows in _actions(sizes, slots, len(agents))]
    started = time.perf_counter()
    for _ in range(episodes):
        env.reset()
        for action in actions:
            env.step(action)
    return episodes * slots / (time.perf_counter() - started)


def sb3_copies(
    make: Callable[[str, int], Any], copies: int = 16, episodes: int = 2
) -> Callable[[str], float]:
    """A VecEnv of Stable-Baselines3, in one process."""

    def measure(scenario: str) -> float:
        vec = make(scenario, copies)
        slots = load_scenario(scenario).num_slots
        actions = _actions(tuple(vec.action_space.nvec), slots, vec.num_envs)
        vec.seed(0)
        vec.reset()
        started = time.perf_counter()
        for _ in range(episodes):
            for action in actions:
                vec.step(action)
        return episodes * slots * copies / (time.perf_counter() - started)

    return measure


def vector_env(scenario: str, copies: int = 4096, episodes: int = 1) -> float:
    """The batched Gymnasium API, float64."""
    env = AUVVectorEnv(scenario, copies)
    slots = env.scenario.num_slots
    actions = _actions(tuple(env.single_action_space.nvec), slots, copies)
    env.reset(seed=0)
    started = time.perf_counter()
    for _ in range(episodes):
        for action in actions:
            env.step(action)
    return episodes * slots * copies / (time.perf_counter() - started)


def batched_world(
    library: Any, copies: int = 4096, *, compiled: bool = False
) -> Callable[[str], float]:
    """The batched world with reward and observation, float32, as the trainer runs it."""

    @functools.cache  # a compiled world is compiled before the first round
    def prepared(name: str) -> tuple[World, Any, list[Any], Callable[..., Any]]:
        scenario = load_scenario(name)
        world = World(scenario, copies, library=library, dtype="float32")
        rngs = [np.random.default_rng(0)] * copies
        state = world.reset(node_codes(scenario, world.grid, rngs))
        actions = [
            world.backend.integers(a)
            for a in _actions(world.action_sizes, world.num_slots, copies, world.num_auvs)
        ]
        slot = torch.compile(world.slot, fullgraph=True) if compiled else world.slot
        second, *_ = slot(state, actions[0])
        slot(second, actions[1])
        return world, state, actions, slot

    def measure(name: str) -> float:
        world, state, actions, slot = prepared(name)
        started = time.perf_counter()
        for action in actions:
            state, _reward, _observation = slot(state, action)
        return world.num_slots * copies / (time.perf_counter() - started)

    return measure


def parallel_env(make: Callable[[], Any], steps: int = 1000) -> Callable[[str], float]:
    """Another project's ParallelEnv."""

    def measure(_: str) -> float:
        env = make()
        env.reset(seed=0)
        agents = env.possible_agents
        choices = [env.action_space(agent).n for agent in agents]
        rng = np.random.default_rng(0)
        actions = [
            dict(zip(agents, row, strict=True))
            for row in rng.integers(0, choices, (steps, len(agents))).tolist()
        ]
        started = time.perf_counter()
        for action in actions:
            if not env.agents:
                env.reset()
            env.step(action)
        return steps / (time.perf_counter() - started)

    return measure


def pursuit() -> Any:
    """PettingZoo's pursuit: one pursuer, 10 evaders, a grid of 10 × 10 cells."""
    from pettingzoo.sisl import pursuit_v5

    return pursuit_v5.parallel_env(max_cycles=100, n_pursuers=1, n_evaders=10, x_size=10, y_size=10)


def particles(agents: int) -> Callable[[], Any]:
    """MPE's simple spread, which PettingZoo had before it became a package of its own."""

    def make() -> Any:
        from mpe2 import simple_spread_v3

        return simple_spread_v3.parallel_env(N=agents, max_cycles=100)

    return make


def vmas_batch(
    agents: int, copies: int = 4096, steps: int = 100, device: str = "cpu"
) -> Callable[[str], float]:
    """VMAS's simple spread, in a batch on torch."""
    synchronise = torch.cuda.synchronize if device == "cuda" else lambda: None

    def measure(_: str) -> float:
        import vmas

        env = vmas.make_env(
            "simple_spread",
            copies,
            device=device,
            continuous_actions=False,
            seed=0,
            n_agents=agents,
        )
        generator = torch.Generator().manual_seed(0)
        choices = [space.n for space in env.action_space]
        actions = [
            [torch.randint(n, (copies,), generator=generator).to(device) for n in choices]
            for _ in range(steps)
        ]
        env.reset()
        synchronise()
        started = time.perf_counter()
        for action in actions:
            env.step(action)
        synchronise()
        return steps * copies / (time.perf_counter() - started)

    return measure


def lacks(*packages: str) -> str | None:
    """Which of the packages are missing, as a reason."""
    missing = [name for name in packages if importlib.util.find_spec(name) is None]
    return f"no package {', '.join(missing)}" if missing else None


def lacks_compiler() -> str | None:
    """Whether torch's compiler has no C++ compiler, as a reason."""
    name = os.environ.get("CXX", "clang++" if sys.platform == "darwin" else "g++")
    return None if shutil.which(name) else f"no C++ compiler {name}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", default="paper/k10-fdd")
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    torch.set_num_threads(1)
    # Deprecations in other projects' code are theirs.
    warnings.simplefilter("ignore")
    no_sb3 = lacks("stable_baselines3")
    #: By name: how fast it is, and why it cannot run, if so.
    subjects: dict[str, tuple[Callable[[str], float], str | None]] = {
        "ParallelEnv": (single, None),
        "ParallelEnv, multi/m3-k10-fdd": (lambda _: single("multi/m3-k10-fdd"), None),
        "sb3_vec_env x 16": (sb3_copies(sb3_vec_env, episodes=20), no_sb3),
        "SuperSuit x 16": (sb3_copies(supersuit_vec_env), no_sb3),
        "VectorEnv x 4096": (vector_env, None),
        "World x 4096, NumPy": (batched_world(np), None),
        "World x 4096, torch": (batched_world(torch), None),
        "World x 4096, torch compiled": (batched_world(torch, compiled=True), lacks_compiler()),
        "PettingZoo pursuit, 1 agent": (parallel_env(pursuit), lacks("pygame")),
        "MPE spread, 1 agent": (parallel_env(particles(1)), lacks("mpe2")),
        "MPE spread, 3 agents": (parallel_env(particles(3)), lacks("mpe2")),
        "VMAS spread x 4096, 1 agent": (vmas_batch(1), lacks("vmas")),
        "VMAS spread x 4096, 3 agents": (vmas_batch(3), lacks("vmas")),
    }
    rates: dict[str, list[float]] = {
        name: [] for name, (_, reason) in subjects.items() if reason is None
    }
    for _ in range(options.repeats):
        for name, values in rates.items():
            values.append(subjects[name][0](options.scenario))
    print(machine.describe())
    print(f"environment steps a second, {options.scenario}, one core, {options.repeats} rounds\n")
    print(f"{'':30s}{'median':>12s}{'min':>12s}{'max':>12s}{'ratio':>9s}")
    for name, values in rates.items():
        ratio = statistics.median(v / s for v, s in zip(values, rates["ParallelEnv"], strict=True))
        row = (statistics.median(values), min(values), max(values))
        print(f"{name:30s}" + "".join(f"{v:12,.0f}" for v in row) + f"{ratio:9.1f}")
    for name, (_, reason) in subjects.items():
        if reason is not None:
            print(f"{name:30s}left out: {reason}")


if __name__ == "__main__":
    main()
