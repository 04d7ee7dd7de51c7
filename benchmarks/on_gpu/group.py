"""A group of one process beside no group."""

from __future__ import annotations

import statistics
import tempfile
from collections.abc import Callable, Iterator
from functools import partial

import torch
from cases import Case, Given, LeftOut, Row
from torch import distributed

from iout_marl.scenario import load_scenario
from on_gpu.equality import difference, iterated, keep_rollouts
from on_gpu.measuring import SCENARIO, WARM, seconds
from trainers import Trainer
from trainers.accel.group import ProcessGroup
from trainers.accel.processes import DistributedGroup


def group(*, use_graphs: bool) -> Case:
    """Exchanges of a group of one, and training by it beside training without."""

    def measure(given: Given) -> Iterator[Row]:
        if use_graphs and given.device == "cpu":
            raise LeftOut("a CPU has no graphs")
        device = torch.device(given.device)
        backend = "nccl" if given.device == "cuda" else "gloo"
        with tempfile.TemporaryDirectory() as folder:
            distributed.init_process_group(
                backend, init_method=f"file://{folder}/store", world_size=1, rank=0
            )
            alone = DistributedGroup(device)
            yield from exchanges(alone, given.device) if not use_graphs else ()
            yield by_group(alone, given, use_graphs=use_graphs)
            distributed.destroy_process_group()

    return measure


def exchanges(alone: ProcessGroup, device: str) -> Iterator[Row]:
    """What a group of one does to numbers, and how long it takes."""
    numbers = torch.arange(250_000, dtype=torch.float32, device=device)
    asked: dict[str, Callable[[], bool]] = {
        "sum": lambda: torch.equal(alone.sum(numbers.clone()), numbers),
        "join": lambda: torch.equal(alone.join(numbers), numbers),
        "any": lambda: alone.any(flag=True) and not alone.any(flag=False),
        "largest": lambda: alone.largest(7) == 7,
    }
    for name, is_right in asked.items():
        right = is_right()
        ms = [1e3 * s for s in seconds(is_right, device, 20)]
        yield {"ms": statistics.median(ms), "what": name, "found": "right" if right else "wrong"}


def by_group(alone: ProcessGroup, given: Given, *, use_graphs: bool) -> Row:
    """Training by a group beside training without one."""
    keep_rollouts()
    small = {"training.environments": 16} if given.quick else {}
    make = partial(Trainer, load_scenario(SCENARIO, small), 3, given.device, use_graphs=use_graphs)
    one, other = make(), make(group=alone)
    found = None
    for number in range(1, WARM + 2):
        expected, got = iterated(one), iterated(other)
        for name, tensor in expected.items():
            if found is None and (by := difference(tensor, got[name])):
                found = f"no: in iteration {number} {name} first, {by}"
    ms = 1e3 * seconds(other.iterate_all, given.device, 1)[0]
    return {"ms": ms, "what": "training", "found": found or "equal to training without a group"}
