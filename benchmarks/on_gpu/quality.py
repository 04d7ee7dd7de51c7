"""The time to a policy of a certain quality, and to many policies."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator

import cases
import time_to_quality
from cases import Case, Given, LeftOut, Row

from iout_marl.scenario import load_scenario
from on_gpu.measuring import SCENARIO, memory
from trainers import Trainer


def to_quality(*, on_cpu: bool = False) -> Case:
    """Seconds from the start of a process to a policy of a certain quality."""

    def measure(given: Given) -> Iterator[Row]:
        if on_cpu and given.device == "cpu":
            raise LeftOut("it is what was measured above")
        device = "cpu" if on_cpu else given.device
        for seed in range(1 if given.quick else 3):
            limit_s = 20.0 if given.quick else 120.0
            outcome = time_to_quality.race(
                time_to_quality.OURS, "best/k10-fdd", seed, limit_s, device
            )
            yield {
                "seed": seed,
                "s": outcome.seconds,
                "steps": outcome.env_steps,
                "mean AoI": outcome.mean_aoi,
            }

    return measure


def many_policies(given: Given) -> Iterator[Row]:
    """A whole training of many policies side by side, at the default preset."""
    policies = 4 if given.quick else 256
    changes = {"training.steps": 204_800} if given.quick else {}
    trainer = Trainer(load_scenario(SCENARIO, changes), device=given.device, replicas=policies)
    iterations = trainer.settings.steps // trainer.steps_per_iteration
    for number in range(1, iterations + 1):
        logs = trainer.iterate_all()
        if number * 4 % iterations < 4:
            ages = [log["aoi/mean"] for log in logs]
            yield {
                "policies": policies,
                "iterations": number,
                "s": time.perf_counter() - cases.STARTED,
                "mean AoI": statistics.mean(ages),
                "min": min(ages),
                "max": max(ages),
                **memory(given.device),
            }
