"""What grows how as scenarios grow: nodes K, AUVs M, cells of the grid, slots of an episode.

One of the four grows at a time; where they stand otherwise, nodes are drawn at random and AUVs
share one band (`channel.access: interference`). Each row is a process of its own. Times are by
processor time, medians of `--repeats` processes; an exponent is the slope of the logarithms from
the row before: 1 is proportional, 2 is quadratic.

    making     `World`: tables of links, energies, cells
    slot       of one environment in the batched world, with reward and observation
    training   one environment step of a training, masks included
    tour       a world is made, and the baseline plans an episode
    bound      the scheduling bound
    memory     of arrays and objects at its highest, while a world is made and a tour planned

The batch shrinks as M·K grows, so that all rows work on arrays of like size.

    python benchmarks/growth.py [--repeats 3] [--axes K M cells slots] [--nodes 100]
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import csv
import json
import math
import statistics
import subprocess
import sys
import time
import tracemalloc
from pathlib import Path
from typing import Any

import machine
import numpy as np
import torch

from iout_marl import evaluate
from iout_marl.bounds.scheduling import delivery_bound
from iout_marl.policies import make_baseline
from iout_marl.scenario import Scenario, load_scenario
from iout_marl.world import World, node_codes
from trainers import Trainer

#: AUV-node pairs in a batch.
PAIRS = 64_000
#: What stands where another of them grows.
BASE = {"M": 1, "K": 10, "cells": (20, 20, 5), "slots": 100}
AXES: dict[str, list[Any]] = {
    "K": [10, 30, 100, 300, 1000],
    "M": [1, 2, 4, 8, 16, 32],
    "cells": [(10, 10, 2), (20, 20, 2), (20, 20, 8), (40, 40, 8), (50, 50, 10)],
    "slots": [30, 100, 300, 1000, 3000],
}
#: What is measured, and in what.
UNITS = {
    "making": "ms",
    "slot": "µs",
    "training": "µs",
    "tour": "ms",
    "bound": "ms",
    "memory": "MB",
}


def scenario(M: int, K: int, cells: tuple[int, ...], slots: int) -> Scenario:  # noqa: N803
    """A team and a network."""
    base = load_scenario("multi/m4-k10-fdd")
    return load_scenario(
        base,
        {
            "grid.cells": list(cells),
            "nodes": {"kind": "random", "count": K, "redraw": "run"},
            "auvs.count": M,
            "episode.duration_s": slots * World(base).link.slot_s,
        },
    )


def measured(size: dict[str, Any]) -> dict[str, float]:
    """The figures of a row, in the units of `UNITS`."""
    chosen = scenario(**size)
    envs = max(PAIRS // (size["M"] * size["K"]), 2)
    rng = np.random.default_rng(0)
    # Whatever is imported on the way is so before anything is measured.
    Trainer(load_scenario("paper/k3-fdd", {"training.environments": 2})).iterate()
    evaluate("paper/k3-fdd", "tour", 1)

    def seconds(work: Any) -> float:
        started = time.process_time()
        work()
        return time.process_time() - started

    found = {"making": 1e3 * seconds(lambda: World(chosen))}
    world = World(chosen, envs, dtype="float32")
    state = world.reset(node_codes(chosen, world.grid, [rng] * envs))
    count = min(20, size["slots"])
    shape = (count, envs, size["M"])
    actions = np.stack([rng.integers(0, n, shape) for n in world.action_sizes], axis=-1)
    state, *_ = world.slot(state, actions[0])

    def play() -> None:
        now = state
        for action in actions[1:]:
            now, *_ = world.slot(now, action)

    found["slot"] = 1e6 * seconds(play) / ((count - 1) * envs)
    settings = {"training.environments": envs, "training.rollout_slots": 10}
    trainer = Trainer(load_scenario(chosen, settings))
    trainer.iterate()
    found["training"] = 1e6 * seconds(trainer.iterate) / trainer.steps_per_iteration

    def plan() -> None:
        lone = World(chosen)
        first = lone.reset(node_codes(chosen, lone.grid, [np.random.default_rng(0)]))
        make_baseline("tour").act(lone, first, rng)

    found["tour"] = 1e3 * seconds(plan)
    found["bound"] = 1e3 * seconds(lambda: delivery_bound(chosen))
    tracemalloc.start()
    plan()
    found["memory"] = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    return found


def row(size: dict[str, Any]) -> dict[str, float]:
    """`measured`, in a process of its own."""
    command = [sys.executable, __file__, "--row", json.dumps(size)]
    found: dict[str, float] = json.loads(
        subprocess.run(command, check=True, capture_output=True).stdout
    )
    return found


def exponent(before: float, now: float, ratio: float) -> str:
    """The slope of the logarithms, or nothing where there is none."""
    if min(before, now) <= 0:
        return ""
    return f"{math.log(now / before) / math.log(ratio):.2f}"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--axes", nargs="+", choices=AXES, default=list(AXES))
    parser.add_argument("--nodes", type=int, default=100, help="where M or cells grow")
    parser.add_argument("--out", type=Path, help="write the table as CSV too")
    parser.add_argument("--row", help=argparse.SUPPRESS)
    options = parser.parse_args()
    torch.set_num_threads(1)
    if options.row:
        print(json.dumps(measured(json.loads(options.row))))
        return
    print(machine.describe())
    rows = []
    for axis in options.axes:
        # Teams are of interest where there is something to share out.
        base = {**BASE, **({"K": options.nodes} if axis in ("M", "cells") else {})}
        print(
            f"\n{axis:>9}"
            + "".join(f" {name + ' ' + unit:>12} {'':5}" for name, unit in UNITS.items())
        )
        last: dict[str, float] | None = None
        last_size = 0
        for value in AXES[axis]:
            size = {**base, axis: value}
            found = [row(size) for _ in range(options.repeats)]
            now = {name: statistics.median(each[name] for each in found) for name in UNITS}
            number = math.prod(value) if axis == "cells" else value
            line = f"{number:>9,}"
            for name in UNITS:
                slope = "" if last is None else exponent(last[name], now[name], number / last_size)
                line += f" {now[name]:>12,.{0 if now[name] >= 100 else 2}f} {slope:>5}"
            print(line, flush=True)
            rows.append(
                {
                    **size,
                    "cells": math.prod(size["cells"]),
                    **{k: round(v, 3) for k, v in now.items()},
                }
            )
            last, last_size = now, number
    if options.out:
        with options.out.open("w", newline="") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)


if __name__ == "__main__":
    main()
