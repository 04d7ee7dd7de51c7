"""What searching at test time gains, and what it costs: layouts that no training has seen.

Every method plays the same layouts, those of the seeds 0, 1, … of `random/kK-DUPLEX`. Means with
95 % confidence intervals, of the layouts and of the difference from the first method; seconds of
processor time for each layout, in one thread.

    python benchmarks/search.py [--nodes 3 5 7 10] [--duplex fdd tdd] [--layouts 20] [--methods …]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import machine
import numpy as np
import torch

from iout_marl import evaluate, load_scenario, pretrained
from iout_marl.bounds.scheduling import delivery_bound
from iout_marl.policies import BasePolicy, BestOf, Budget, GuidedBeam, PlannerPolicy, Tour
from iout_marl.world import pin_layout

ROUNDS = 16
METHODS: dict[str, Callable[[], BasePolicy]] = {
    f"planner, {ROUNDS} rounds": lambda: PlannerPolicy(Budget(rounds=ROUNDS)),
    "tour": Tour,
    "pretrained": pretrained,
    "pretrained, mirrored": lambda: BestOf(pretrained(), mirrored=True),
    "pretrained, best of 16": lambda: BestOf(pretrained(), 16),
    "pretrained, best of 128, mirrored": lambda: BestOf(pretrained(), 128, mirrored=True),
    "pretrained, beam of 4": lambda: GuidedBeam(pretrained(), 4),
    "pretrained, beam of 16": lambda: GuidedBeam(pretrained(), 16),
    f"planner from pretrained, {ROUNDS} rounds": lambda: PlannerPolicy(
        Budget(rounds=ROUNDS), warm=[pretrained()]
    ),
}


def spread(values: np.ndarray) -> float:
    """Half of the 95 % confidence interval of a mean."""
    return float(1.96 * values.std(ddof=1) / np.sqrt(len(values)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--nodes", type=int, nargs="+", default=[3, 5, 7, 10])
    parser.add_argument("--duplex", nargs="+", default=["fdd", "tdd"])
    parser.add_argument("--layouts", type=int, default=20)
    parser.add_argument("--methods", nargs="+", choices=list(METHODS), default=list(METHODS))
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    print(machine.describe())
    for duplex in arguments.duplex:
        for nodes in arguments.nodes:
            show(f"random/k10-{duplex}", nodes, arguments.layouts, arguments.methods)


def show(name: str, nodes: int, layouts: int, methods: list[str]) -> None:
    """One table."""
    scenario = load_scenario(name, {"nodes.count": nodes})
    pinned = [pin_layout(scenario, seed) for seed in range(layouts)]
    bound = delivery_bound(scenario)
    print(f"\n{name}, K = {nodes}: {layouts} layouts; no policy below {bound:.3f}")
    print(f"{'':38} {'mean AoI':>15} {'over the first':>16} {'s a layout':>11}")
    reference: np.ndarray | None = None
    for method in methods:
        begun = time.process_time()
        found = np.array(
            [evaluate(each, METHODS[method](), 1).samples["mean_aoi"][0] for each in pinned]
        )
        seconds = (time.process_time() - begun) / layouts
        reference = found if reference is None else reference
        over = 100 * (found / reference - 1)
        mean = f"{found.mean():.3f} ± {spread(found):.3f}"
        print(f"{method:38} {mean:>15} {over.mean():+7.1f} ± {spread(over):.1f} % {seconds:11.2f}")


if __name__ == "__main__":
    main()
