"""Training by the number of environments and of policies."""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import partial
from typing import Any

import torch
from cases import Case, Given, LeftOut, Row

from iout_marl.scenario import load_scenario
from on_gpu.measuring import (
    SCENARIO,
    WARM,
    forget,
    memory,
    rate,
    seconds,
    synchronise,
    while_it_fits,
)
from trainers import Trainer


def training(
    name: str,
    sizes_on_cpu: list[int],
    sizes: list[int],
    changes: dict[str, Any],
    *,
    use_graphs: bool = True,
    on_cpu: bool = False,
    precision: str = "highest",
) -> Case:
    """Iterations of training, by environments or by policies side by side."""

    def measure_size(device: str, size: int) -> Row:
        forget(device)
        replicas = size if name == "policies" else 1
        envs = 16 if name == "policies" else size
        scenario = load_scenario(SCENARIO, {"training.environments": envs, **changes})
        started = time.perf_counter()
        trainer = Trainer(scenario, device=device, replicas=replicas, use_graphs=use_graphs)
        for _ in range(WARM):
            trainer.iterate_all()
        synchronise(device)
        ready_s = time.perf_counter() - started
        found = rate(replicas * trainer.steps_per_iteration, seconds(trainer.iterate_all, device))
        return {**found, "ready after s": ready_s, **memory(device)}

    def measure(given: Given) -> Iterator[Row]:
        if on_cpu and given.device == "cpu":
            raise LeftOut("it is what was measured above")
        device = "cpu" if on_cpu else given.device
        if device == "cpu" and not use_graphs:
            raise LeftOut("a CPU has no graphs")
        if device == "cpu" and precision != "highest":
            raise LeftOut("a CPU has no TF32")
        torch.set_float32_matmul_precision(precision)
        wanted = sizes_on_cpu if device == "cpu" else sizes
        wanted = [1, 4] if given.quick and name == "policies" else [16] if given.quick else wanted
        return while_it_fits(wanted, name, partial(measure_size, device))

    return measure
