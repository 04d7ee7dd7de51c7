"""Seconds from the start of a process to a policy of a certain quality.

Quality is the mean AoI of the deterministic policy on the paper's FDD world with 10 nodes:
at most 7.5 under the paper's reward, at most 6.0 under the mean-AoI reward. Every learner
runs in a process of its own, one after the other, with one torch thread; after every bit of
learning its policy plays an episode, which counts to its time. A learner that has not come
there when the limit is over is stopped.

    python benchmarks/time_to_quality.py [--seeds 5] [--others 1] [--limit 300]
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import time
from typing import NamedTuple

import machine

TARGETS = {"paper/k10-fdd": 7.5, "best/k10-fdd": 6.0}
OURS = "this trainer"


class Outcome(NamedTuple):
    """How far a learner came."""

    seconds: float | None  # to the target; None where it was not reached
    env_steps: int
    mean_aoi: float


def learn(name: str, scenario: str, seed: int, device: str) -> None:
    """In a process of its own: learn, and print a line after every bit of it, without end."""
    import torch
    from contestants import LEARNERS

    from iout_marl import evaluate, load_scenario

    torch.set_num_threads(1)
    where = {"device": device} if name == OURS else {}
    learner = LEARNERS[name](load_scenario(scenario), seed, **where)
    while True:
        steps = learner.learn()
        metrics = evaluate(learner.scenario, learner.policy(), episodes=1).metrics
        print(json.dumps([steps, metrics["mean_aoi"].mean]), flush=True)


def race(name: str, scenario: str, seed: int, limit_s: float, device: str = "cpu") -> Outcome:
    """Run a learner until it reaches the scenario's target, or to the limit.

    Args:
        name: the learner.
        scenario: what it learns.
        seed: its seed.
        limit_s: the limit.
        device: where this trainer learns; the others do on a CPU.
    """
    started = time.perf_counter()
    command = [sys.executable, __file__, "--learn", name, scenario, str(seed), device]
    steps, aoi = 0, float("inf")
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            seconds = time.perf_counter() - started
            steps, aoi = json.loads(line)
            if aoi <= TARGETS[scenario] or seconds > limit_s:
                process.kill()
                break
        else:
            sys.exit(f"{name} ended early")
    return Outcome(seconds if aoi <= TARGETS[scenario] else None, steps, aoi)


def table(outcomes: dict[str, list[Outcome]], limit_s: float) -> None:
    """Print the medians of one target, and ratios to this trainer's."""
    print(
        f"{'':38s}{'seeds':>6s}{'median s':>10s}{'min':>8s}{'max':>8s}{'steps':>12s}{'ratio':>8s}"
    )
    ours = statistics.median(o.seconds or limit_s for o in outcomes[OURS])
    for name, runs in outcomes.items():
        there = sorted(o.seconds for o in runs if o.seconds is not None)
        steps = statistics.median(o.env_steps for o in runs)
        if len(there) * 2 > len(runs):
            missing = [float("inf")] * (len(runs) - len(there))
            median = statistics.median([*there, *missing])
            times = f"{median:10.1f}{there[0]:8.1f}{(missing or there)[-1]:8.1f}"
            print(f"{name:38s}{len(runs):6d}{times}{steps:12,.0f}{median / ours:8.1f}")
        else:
            aoi = statistics.median(o.mean_aoi for o in runs)
            words = f"not within {limit_s:.0f} s: mean AoI {aoi:.2f}"
            print(f"{name:38s}{len(runs):6d}  {words:24s}{steps:12,.0f}{limit_s / ours:>7.0f}+")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5, help="of this trainer")
    parser.add_argument("--others", type=int, default=1, help="seeds of the others")
    parser.add_argument("--limit", type=float, default=300.0, help="seconds")
    parser.add_argument("--learn", nargs=4, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.learn:
        name, scenario, seed, device = options.learn
        learn(name, scenario, int(seed), device)
    from contestants import LEARNERS

    print(machine.describe())
    for scenario, target in TARGETS.items():
        outcomes: dict[str, list[Outcome]] = {}
        for name in LEARNERS:
            for seed in range(options.seeds if name == OURS else options.others):
                outcome = race(name, scenario, seed, options.limit)
                outcomes.setdefault(name, []).append(outcome)
        print(f"\n{scenario}: seconds to a mean AoI of {target}, one torch thread\n")
        table({k: v for k, v in outcomes.items() if v}, options.limit)


if __name__ == "__main__":
    main()
