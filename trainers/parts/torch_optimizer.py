"""Any optimizer of torch, by the name of its class."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pydantic import Field

from iout_marl import parts
from iout_marl.errors import InputError, did_you_mean
from iout_marl.scenario import Training
from iout_marl.scenario.fields import Text


@parts.optimizers.register("torch")
class TorchOptimizer(parts.Optimizer):
    """A class of `torch.optim`: `optimizer: RMSprop` is short for its name alone.

    Of several policies side by side each has one of its own.
    """

    class Settings(parts.Settings):
        """Which, and with which options."""

        #: Name of the class: `AdamW`, `SGD`, say.
        name: Text
        #: What it takes beside parameters and learning rate: `weight_decay: 0.01`, say.
        options: dict[str, Any] = Field(default_factory=dict)

    @property
    def name(self) -> str:
        """The class."""
        return f"torch.optim.{self.settings.name}"

    def make(self, parameters: Sequence[Any], training: Training) -> Any:
        """See `Optimizer.make`.

        Raises:
            InputError: torch has no such class.
        """
        import torch

        found: dict[str, Any] = {
            name: item
            for name, item in vars(torch.optim).items()
            if isinstance(item, type)
            and issubclass(item, torch.optim.Optimizer)
            and item is not torch.optim.Optimizer
        }
        name = self.settings.name
        if name not in found:
            raise InputError(
                f"training.optimizer: torch.optim has no optimizer {name!r}"
                f"{did_you_mean(name, found)}"
            )
        return found[name](parameters, lr=training.learning_rate, **self.settings.options)
