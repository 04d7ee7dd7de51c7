"""What the scripts share: the scenario, its options, and the figure that they print."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

import torch
from torch.distributions import Categorical, Independent

from iout_marl import Scenario, evaluate, load_scenario

#: Uplinks share one band; observations in [0, 1], with the time, as networks like them.
SETTINGS = {
    "channel.access": "interference",
    "observation.kind": "scaled",
    "observation.time": True,
}


class MultiCategorical(Independent):
    """A Categorical for each entry of a MultiDiscrete action, of (…, entries · longest) logits."""

    def __init__(self, logits: torch.Tensor, sizes: list[int]) -> None:
        beyond = torch.arange(max(sizes)) >= torch.tensor(sizes)[:, None]
        logits = logits.unflatten(-1, beyond.shape).masked_fill(beyond, -torch.inf)
        super().__init__(Categorical(logits=logits), 1)


def parse(
    description: str, arguments: list[str] | None, steps: int = 30_000
) -> tuple[argparse.Namespace, Scenario]:
    """The options `steps` and `seed`, and the scenario that the others ask for."""
    parser = argparse.ArgumentParser(description=description.splitlines()[0])
    parser.add_argument("--scenario", default="best/k10-fdd")
    parser.add_argument("--auvs", type=int, default=3)
    parser.add_argument("--steps", type=int, default=steps, help="actions of all AUVs together")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    return options, load_scenario(options.scenario, {"auvs.count": options.auvs, **SETTINGS})


def mean_aoi(scenario: Scenario, policy: Callable[[Any], Any]) -> float:
    """Mean Age of Information over 100 episodes, in slots."""
    return evaluate(scenario, policy, episodes=100).metrics["mean_aoi"].mean


def tell(name: str, before: float, after: float, steps: int) -> tuple[float, float]:
    """Prints and returns the mean AoI before and after."""
    print(f"{name}: mean AoI {before:.2f} before, {after:.2f} after {steps} steps")
    return before, after
