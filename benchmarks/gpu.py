"""What there is to learn from half an hour on one NVIDIA GPU, in one JSON.

Does it work: the tests that need such a device, training by captured graphs beside eager
training to the last bit, an NCCL group. How fast is it: the world, training, the time to a
policy of a certain quality, other people's environments. And why: a profile of an iteration.

Each case runs in a process of its own with a limit of time, so that a crash, a hang or a lack
of memory costs that case alone. The JSON is written anew after every case. Without a CUDA
device every step says so; `--device cpu` runs what a CPU can do, graphs by their emulation
in `tests/emulated_graph.py`.

    python benchmarks/gpu.py [--steps tests equal …] [--minutes 30] [--quick] [--out gpu.json]
    python benchmarks/gpu.py --device cpu --steps world training --minutes 60
"""

from __future__ import annotations

import cases
import numpy as np
import torch
from cases import Step
from on_gpu.equality import SETTINGS, equal
from on_gpu.group import group
from on_gpu.measuring import SCENARIO, SET_NETWORK, about, powers
from on_gpu.others import gymnax_cartpole, jaxmarl_spread, vmas_spread, world_on_jax
from on_gpu.profiling import profile
from on_gpu.quality import many_policies, to_quality
from on_gpu.testing import OF_GRAPHS, run_tests, tests_of_gpus
from on_gpu.training import training
from on_gpu.world import world_alone

STEPS = {
    "tests": Step(
        "do the tests pass that need a CUDA device, and those of what runs there?",
        300.0,
        {
            "marked gpu": run_tests("-m", "gpu", *tests_of_gpus()),
            "the others of graphs": run_tests("-m", "not gpu", *OF_GRAPHS),
        },
    ),
    "equal": Step(
        "is captured training eager training, bit for bit?",
        120.0,
        {
            **{name: equal(name) for name in SETTINGS},
            "deterministic algorithms": equal("paper/k10-fdd", deterministic=True),
        },
    ),
    "world": Step(
        f"environment steps a second, {SCENARIO}, with reward and observation",
        240.0,
        {
            "captured": world_alone(torch, captured=True),
            "eager": world_alone(torch),
            "compiled, captured": world_alone(torch, captured=True, compiled=True),
            "compiled": world_alone(torch, compiled=True),
            "NumPy": world_alone(np),
        },
    ),
    "training": Step(
        f"training steps a second, {SCENARIO}, policies with 16 environments each",
        180.0,
        {
            "MLP": training("environments", powers(4, 4096), powers(256, 65_536), {}),
            "policies": training("policies", powers(1, 64), powers(1, 4096), {}),
            "set network": training(
                "environments", powers(16, 256), powers(256, 16_384), SET_NETWORK
            ),
            "MLP, eager": training("environments", [], powers(256, 4096), {}, use_graphs=False),
            "MLP, TF32": training("environments", [], powers(4096, 65_536), {}, precision="high"),
            "MLP, cpu": training("environments", powers(256, 4096), [], {}, on_cpu=True),
        },
    ),
    "quality": Step(
        "seconds from the start: to a mean AoI of 6.0 in best/k10-fdd; of many policies",
        300.0,
        {
            "this trainer": to_quality(),
            f"many policies, {SCENARIO}": many_policies,
            "this trainer, cpu": to_quality(on_cpu=True),
        },
    ),
    "nccl": Step(
        "does a group of one process do what no group does?",
        90.0,
        {"eager": group(use_graphs=False), "captured": group(use_graphs=True)},
    ),
    "profile": Step(
        f"what does an iteration consist of, {SCENARIO}?",
        120.0,
        {
            "captured": profile({}, use_graphs=True),
            "eager": profile({}, use_graphs=False),
            "set network, captured": profile(SET_NETWORK, use_graphs=True),
        },
    ),
    "others": Step(
        "environment steps a second of others, and of this world on JAX",
        180.0,
        {
            "this world on JAX, at once": world_on_jax(at_once=True),
            "this world on JAX, by slots": world_on_jax(at_once=False),
            "VMAS spread, 1 agent": vmas_spread(1),
            "VMAS spread, 3 agents": vmas_spread(3),
            "JaxMARL spread, 3 agents": jaxmarl_spread(3),
            "Gymnax CartPole": gymnax_cartpole,
        },
    ),
}


if __name__ == "__main__":
    torch.set_num_threads(1)
    assert __doc__ is not None
    cases.main(__doc__.splitlines()[0], STEPS, about)
