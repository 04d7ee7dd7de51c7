"""What changes the weights of a policy along their gradients."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar

from iout_marl.parts.base import Part
from iout_marl.registry import Registry
from iout_marl.scenario import Training


class Optimizer(Part, ABC):
    """An optimizer of the trainer.

    Attributes:
        is_stacked: whether `make` takes the parameters of all policies at once, (policies, …)
            each, and returns a `trainers.optimizers.Optimizer`.
    """

    is_of_world: ClassVar[bool] = False
    is_stacked: ClassVar[bool] = False

    @property
    def name(self) -> str:
        """What messages call it."""
        kind: str = self.settings.kind
        return kind

    @abstractmethod
    def make(self, parameters: Sequence[Any], training: Training) -> Any:
        """A `torch.optim.Optimizer` of one policy's parameters.

        The learning rate is set before every step, and gradients come clipped.

        Args:
            parameters: leaf tensors, whose `grad` is set before every step.
            training: settings of the training.
        """


optimizers: Registry[type[Optimizer]] = Registry("optimizer", Optimizer)
