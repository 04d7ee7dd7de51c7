"""A reward of one's own: the age of the node that has waited longest.

Where this file is imported, scenarios can name it:

    reward: {kind: peak_age, weight: 0.5}

python examples/extending/reward.py [--steps 20000]

checks it, trains on it, and prints how old data become, beside a baseline.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

import torch

from iout_marl import Trainer, evaluate, load_scenario, parts
from iout_marl.testing import check_part
from iout_marl.world import Events, State


@parts.rewards.register("peak_age", version=1)
class PeakAge(parts.Reward):
    """r = −weight · max A_k, the same for every AUV."""

    class Settings(parts.Settings):
        weight: parts.Positive = 1.0

    def bounds(self, scenario: Any) -> dict[str, float]:
        """How large it can make the reward of a slot, by the key that does; optional."""
        return {"reward.weight": self.settings.weight * scenario.age.maximum}

    def __call__(self, state: State, events: Events) -> Mapping[str, Any]:
        """Terms by name, (envs, auvs) each; (envs, 1) is for all AUVs alike."""
        worst = self.xp.max(state.age, axis=-1, keepdims=True)
        return {"age": -self.settings.weight * worst}


def main(options: list[str] | None = None) -> dict[str, float]:
    """Mean over episodes of the highest age, in slots, of each policy."""
    torch.set_num_threads(1)  # more cost time on networks of this size
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--steps", type=int, default=20_000)
    steps = parser.parse_args(options).steps

    check_part(parts.rewards, "peak_age", {"weight": 0.5})
    scenario = load_scenario(
        "paper/k3-fdd",
        {
            "reward": {"kind": "peak_age", "weight": 0.5},
            "training.steps": steps,
            "training.environments": 10,
            "training.rollout_slots": 50,
        },
    )
    trainer = Trainer(scenario, seed=0)
    policies = {"random-walk": "random-walk", "greedy": "greedy", "untrained": trainer.policy()}
    found = {name: evaluate(scenario, policy, 50) for name, policy in policies.items()}
    while not trainer.finished:
        trainer.iterate()
    found["trained"] = evaluate(scenario, trainer.policy(), 50)
    print(f"{'policy':12}  mean AoI  peak AoI  reward")
    for name, evaluation in found.items():
        means = [evaluation.metrics[m].mean for m in ("mean_aoi", "peak_aoi", "reward")]
        print(f"{name:12}  {means[0]:8.2f}  {means[1]:8.2f}  {means[2]:6.0f}")
    return {name: evaluation.metrics["reward"].mean for name, evaluation in found.items()}


if __name__ == "__main__":
    main()
