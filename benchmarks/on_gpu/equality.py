"""Captured training beside eager training, to the last bit."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from functools import partial
from typing import Any

import torch
from cases import ROOT, Case, Given, Row
from torch import Tensor

from iout_marl.scenario import load_scenario
from on_gpu.measuring import SET_NETWORK, synchronise
from trainers import Trainer
from trainers.accel import graphs
from trainers.collector import Collector

#: Scenario, changes, policies side by side.
SETTINGS: dict[str, tuple[str, dict[str, Any], int]] = {
    "paper/k10-fdd": ("paper/k10-fdd", {}, 1),
    "best/k10-tdd": ("best/k10-tdd", {"training.mask_actions": True}, 1),
    "multi/m3-k10-fdd": ("multi/m3-k10-fdd", {}, 1),
    "4 policies": ("paper/k10-fdd", {}, 4),
    "running scaling": (
        "best/k10-fdd",
        {"training.observation_scaling": "running", "training.reward_scaling": "running"},
        1,
    ),
    "central critic": ("multi/m2-k10-fdd", {"training.critic": "central"}, 1),
    "set network": ("best/k10-fdd", SET_NETWORK, 1),
    "sea/bay-tide": ("sea/bay-tide", {"training.rollout_slots": 100}, 1),
}


def emulate_graphs() -> None:
    """Let a CPU do what a CUDA device does: the world on torch, and graphs."""
    from trainers import collector

    sys.path.insert(0, str(ROOT / "tests"))
    from emulated_graph import EmulatedGraph

    collector.NUMPY_DEVICES = ()
    graphs.GRAPHS["cpu"] = EmulatedGraph


def keep_rollouts() -> None:
    """Let a collector know the last rollout that it has collected."""
    collect = Collector.collect

    def kept(self: Collector, *args: Any, **kwargs: Any) -> Any:
        self.last_rollout = collect(self, *args, **kwargs)  # type: ignore[attr-defined]
        return self.last_rollout  # type: ignore[attr-defined]

    Collector.collect = kept  # type: ignore[method-assign]


def iterated(trainer: Trainer) -> dict[str, Tensor]:
    """All numbers of one more iteration, in the order in which they come about."""
    logs = trainer.iterate_all()
    rollout = trainer.collector.last_rollout  # type: ignore[attr-defined]
    found = {
        f"rollout.{name}": tensor.detach().clone()
        for name, tensor in vars(rollout).items()
        if isinstance(tensor, Tensor)
    }
    for tag in logs[0]:
        if not tag.startswith("speed/"):
            numbers = [log[tag] for log in logs]
            found[tag] = torch.tensor(numbers, dtype=torch.float64)
    for name, tensor in trainer.network.state_dict().items():
        found[f"weights.{name}"] = tensor.clone()
    return found


def difference(one: Tensor, other: Tensor) -> str | None:
    """By how much tensors differ, if they do; numbers that are none are equal."""
    differs = (one != other) & ~((one != one) & (other != other))
    count = int(differs.sum())
    if not count:
        return None
    apart = (one.double() - other.double()).abs()
    return (
        f"{count:,} of {one.numel():,} numbers, by {float(apart.max()):.3g} at most, "
        f"of {float(one.double().abs().max()):.3g}"
    )


def equal(setting: str, *, deterministic: bool = False) -> Case:
    """Captured training beside eager training, and eager training beside itself."""

    def compare(given: Given) -> Iterator[Row]:
        if given.device == "cpu":
            emulate_graphs()
        if deterministic:
            # Before the first product; without it cuBLAS may add up otherwise on another stream.
            os.environ["CUBLAS_WORKSPACE_CONFIG"] = ":4096:8"
            torch.use_deterministic_algorithms(mode=True, warn_only=True)
        keep_rollouts()
        name, changes, replicas = SETTINGS[setting]
        small = {"training.environments": 16, "training.rollout_slots": 10}
        scenario = load_scenario(name, {**changes, **(small if given.quick else {})})
        make = partial(Trainer, scenario, 3, given.device, replicas)
        trainers = {
            "eager": make(use_graphs=False),
            "eager again": make(use_graphs=False),
            "captured": make(),
        }
        iterations = 4 if given.quick else 6
        differs: dict[str, str] = {}
        ms: dict[str, float] = {}
        last: dict[str, dict[str, Tensor]] = {}
        for number in range(1, iterations + 1):
            for subject, trainer in trainers.items():
                synchronise(given.device)
                started = time.perf_counter()
                last[subject] = iterated(trainer)
                synchronise(given.device)
                ms[subject] = 1e3 * (time.perf_counter() - started)
                for tensor, expected in last["eager"].items():
                    by = difference(expected, last[subject][tensor])
                    if by and subject not in differs:
                        differs[subject] = f"no: in iteration {number} {tensor} first, {by}"
        for subject in ("captured", "eager again"):
            weights = [
                float((tensor.double() - last[subject][name].double()).abs().max())
                for name, tensor in last["eager"].items()
                if name.startswith("weights.")
            ]
            yield {
                "ms, eager": ms["eager"],
                "ms": ms[subject],
                "weights by": max(weights),
                "beside eager": subject,
                "equal": differs.get(subject, f"yes, for {iterations} iterations"),
            }

    return compare
