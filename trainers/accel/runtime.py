"""What a trainer runs on."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import torch
from torch import Tensor

from iout_marl.errors import InputError
from iout_marl.scenario import Training
from trainers.accel.graphs import GRAPHS, CapturedFunction
from trainers.accel.group import ProcessGroup

Result = TypeVar("Result")


class Runtime:
    """A device, the processes that share the environments, and how functions are run.

    Args:
        device: where the tensors are.
        group: the processes; None for this one alone.
        use_graphs: capture functions as graphs, where the device can. Several processes capture
            nothing: what they exchange cannot be captured.

    Attributes:
        captures: whether functions are captured.
    """

    def __init__(
        self,
        device: str | torch.device = "cpu",
        group: ProcessGroup | None = None,
        *,
        use_graphs: bool = True,
    ) -> None:
        self.device = torch.device(device)
        self.group = group or ProcessGroup()
        self._graph = GRAPHS.get(self.device.type) if self.group.size == 1 and use_graphs else None
        self.captures = self._graph is not None

    def check(self, settings: Training, replicas: int) -> None:
        """See that the processes can train so many policies together.

        Raises:
            InputError: they cannot.
        """
        size = self.group.size
        if settings.environments % size:
            raise InputError(
                f"training.environments: {settings.environments} cannot be shared evenly by "
                f"{size} processes"
            )
        if size > 1 and replicas > 1:
            raise InputError(
                "--replicas: policies side by side are trained by one process, without torchrun"
            )

    def capture(self, function: Callable[..., Result]) -> Callable[..., Result]:
        """A function to be called again and again, run as fast as the device can.

        See `CapturedFunction` for what it may take and do where functions are captured;
        elsewhere it is what it was.
        """
        if self._graph is None:
            return function
        return CapturedFunction(function, self._graph, self.device)

    def sum(self, tensor: Tensor) -> Tensor:
        """The sum of every process's tensor, the same in all; may be written into it."""
        return self.group.sum(tensor)
