"""An optimizer of one's own: Lion (Chen et al., 2023), the sign of a mixed momentum.

Used by a scenario; one of torch needs no file, but its name alone (`optimizer: AdamW`):

    training: {optimizer: {kind: lion, decay: 0.95}, learning_rate: 1.0e-3}

    iout train mine.yaml --import examples/extending/optimizer.py

Run as a script, it trains on the paper's smallest scenario, beside Adam.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from iout_marl import Trainer, evaluate, load_scenario, parts
from iout_marl.scenario import Training

SCENARIO = "paper/k3-fdd"


class Lion(torch.optim.Optimizer):
    """θ ← θ − lr · sign(β₁ m + (1 − β₁) g); m ← β₂ m + (1 − β₂) g."""

    def __init__(self, parameters: Sequence[Tensor], lr: float, beta: float, decay: float) -> None:
        super().__init__(parameters, {"lr": lr, "beta": beta, "decay": decay})

    @torch.no_grad()
    def step(self) -> None:
        """Take a step along the gradients."""
        for group in self.param_groups:
            for parameter in group["params"]:
                gradient, state = parameter.grad, self.state[parameter]
                momentum = state.setdefault("momentum", torch.zeros_like(parameter))
                mixed = torch.lerp(gradient, momentum, group["beta"])
                parameter.sub_(mixed.sign(), alpha=group["lr"])
                momentum.lerp_(gradient, 1 - group["decay"])


@parts.optimizers.register("lion", version=1)
class LionOptimizer(parts.Optimizer):
    """Lion; its learning rate is some four times smaller than Adam's."""

    class Settings(parts.Settings):
        beta: parts.Fraction = 0.9
        decay: parts.Fraction = 0.99

    def make(self, parameters: Sequence[Any], training: Training) -> torch.optim.Optimizer:
        """See `parts.Optimizer.make`."""
        return Lion(parameters, training.learning_rate, self.settings.beta, self.settings.decay)


def main(options: list[str] | None = None) -> dict[str, float]:
    """Mean AoI in slots, of greedy decoding, by optimizer."""
    torch.set_num_threads(1)  # more cost time on networks of this size
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--steps", type=int, default=128_000)
    steps = parser.parse_args(options).steps
    common = {
        "training.steps": steps,
        "training.environments": 64,
        "training.rollout_slots": 50,
        "training.mask_actions": True,
    }
    rates = {"adam": 4e-3, "AdamW": 4e-3, "lion": 1e-3}
    found = {}
    print("optimizer  mean AoI")
    for optimizer, rate in rates.items():
        changes = {"training.optimizer": optimizer, "training.learning_rate": rate}
        scenario = load_scenario(SCENARIO, {**common, **changes})
        trainer = Trainer(scenario)
        while not trainer.finished:
            trainer.iterate()
        found[optimizer] = evaluate(scenario, trainer.policy(), 20).metrics["mean_aoi"].mean
        print(f"{optimizer:9}  {found[optimizer]:8.2f}")
    return found


if __name__ == "__main__":
    main()
