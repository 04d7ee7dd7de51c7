"""Optimizers of one policy, or of several side by side, with all gradients in one row each.

One row for all weights of a policy makes their norm and the sum over processes one operation each.
"""

from __future__ import annotations

import copy
import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor, nn

from iout_marl.errors import InputError
from iout_marl.scenario import Training

DECAYS = (0.9, 0.999)


class Optimizer(ABC):
    """Changes weights along their gradients.

    Args:
        parameters: (policies, …) each.
    """

    #: Whether the host is never asked for a number, so that the steps can be captured as graphs.
    can_be_captured = True

    def __init__(self, parameters: Sequence[nn.Parameter]) -> None:
        self._parameters = list(parameters)
        self._sizes = [p[0].numel() for p in self._parameters]

    def gradient(self) -> Tensor:
        """The gradients of all weights, (policies, weights); the parameters lose them.

        Those that the loss does not depend on have a gradient of 0.
        """
        rows = []
        for parameter in self._parameters:
            gradient = parameter.grad
            rows.append((torch.zeros_like(parameter) if gradient is None else gradient).flatten(1))
            parameter.grad = None
        return torch.cat(rows, dim=-1)

    @abstractmethod
    def step(self, gradient: Tensor, learning_rate: float | Tensor) -> None:
        """Take a step.

        Args:
            gradient: (policies, weights), summed over processes and clipped.
            learning_rate: a number, or () float64 where steps are captured.
        """

    @abstractmethod
    def state_dict(self, policy: int = 0) -> dict[str, Any]:
        """What `load_state_dict` continues from, for one policy: tensors and plain values.

        It has `steps`, how many were taken; its structure and shapes are always the same.
        """

    @abstractmethod
    def load_state_dict(self, saved: Sequence[dict[str, Any]]) -> None:
        """Continue from the `state_dict` of each policy."""

    def _split(self, row: Tensor) -> list[Tensor]:
        """(policies, weights) as the parameters are shaped."""
        parts = torch.split(row, self._sizes, dim=-1)
        return [part.view_as(p) for part, p in zip(parts, self._parameters, strict=True)]


class Adam(Optimizer):
    """Adam (Kingma and Ba, 2015) on all weights at once.

    `torch.optim` takes a second to import, a third of the time that a training takes to start.

    Args:
        parameters: (policies, …) each.
        epsilon: added to the root of the second moment.
    """

    def __init__(self, parameters: Sequence[nn.Parameter], epsilon: float) -> None:
        super().__init__(parameters)
        self._epsilon = epsilon
        like = self._parameters[0]
        #: Moments of the gradient, (policies, weights).
        self.first = like.new_zeros((len(like), sum(self._sizes)), requires_grad=False)
        self.second = torch.zeros_like(self.first)
        #: Steps taken, counted where the weights are, so that steps can be captured.
        self.steps = torch.zeros((), dtype=torch.float64, device=like.device)

    @torch.no_grad()
    def step(self, gradient: Tensor, learning_rate: float | Tensor) -> None:
        """See `Optimizer.step`."""
        self.steps += 1
        first_decay, second_decay = DECAYS
        self.first.lerp_(gradient, 1 - first_decay)
        self.second.mul_(second_decay).addcmul_(gradient, gradient, value=1 - second_decay)
        root = (self.second / (1 - second_decay**self.steps)).sqrt_().add_(self._epsilon)
        change = (self.first / root).mul_(-learning_rate / (1 - first_decay**self.steps))
        for parameter, part in zip(self._parameters, self._split(change), strict=True):
            parameter.add_(part)

    def state_dict(self, policy: int = 0) -> dict[str, Any]:
        """See `Optimizer.state_dict`."""
        first, second = self.first[policy].clone(), self.second[policy].clone()
        return {"first": first, "second": second, "steps": int(self.steps)}

    def load_state_dict(self, saved: Sequence[dict[str, Any]]) -> None:
        """See `Optimizer.load_state_dict`."""
        for name, moment in (("first", self.first), ("second", self.second)):
            moment.copy_(torch.stack([one[name] for one in saved]))
        self.steps.fill_(saved[0]["steps"])


class TorchOptimizer(Optimizer):
    """An optimizer of torch for each policy, as if the policy were trained alone.

    Args:
        parameters: (policies, …) each.
        make: makes the optimizer of one policy's parameters.
        name: what messages call it.

    Raises:
        InputError: it does not take steps along the gradients that it is given.
    """

    can_be_captured = False

    def __init__(
        self,
        parameters: Sequence[nn.Parameter],
        make: Callable[[list[Tensor]], torch.optim.Optimizer],
        name: str,
    ) -> None:
        super().__init__(parameters)
        #: The parameters of each policy, in the memory of the stacked ones.
        self._own = [[p.detach()[i] for p in parameters] for i in range(len(parameters[0]))]
        self._name = name
        try:
            self._check_closure(make(self._own[0]))
            self._optimizers = [make(own) for own in self._own]
            # What an optimizer keeps is there after its first step: one on zeros, on a copy.
            copies = copy.deepcopy(self._own)
            self._like = [_first_step(make(own)) for own in copies]
        except InputError:
            raise
        except (TypeError, ValueError, RuntimeError) as error:
            reason = str(error).strip().partition("\n")[0]
            raise InputError(f"training.optimizer: {name}: {reason}") from None
        self._steps = 0

    def _check_closure(self, optimizer: torch.optim.Optimizer) -> None:
        closure = inspect.signature(optimizer.step).parameters.get("closure")
        if closure is not None and closure.default is inspect.Parameter.empty:
            raise TypeError("evaluates the loss again and again within a step, which PPO cannot")

    def step(self, gradient: Tensor, learning_rate: float | Tensor) -> None:
        """See `Optimizer.step`."""
        rows = self._split(gradient)
        for policy, (own, optimizer) in enumerate(zip(self._own, self._optimizers, strict=True)):
            for parameter, row in zip(own, rows, strict=True):
                parameter.grad = row[policy]
            for group in optimizer.param_groups:
                group["lr"] = float(learning_rate)
            optimizer.step()
        self._steps += 1

    def state_dict(self, policy: int = 0) -> dict[str, Any]:
        """See `Optimizer.state_dict`."""
        state = _state(self._optimizers[policy]) if self._steps else self._like[policy]
        return {"state": state, "steps": self._steps}

    def load_state_dict(self, saved: Sequence[dict[str, Any]]) -> None:
        """See `Optimizer.load_state_dict`."""
        self._steps = saved[0]["steps"]
        for one, optimizer in zip(saved, self._optimizers, strict=True):
            state = {int(k): copy.deepcopy(v) for k, v in one["state"].items()}
            whole = optimizer.state_dict()
            optimizer.load_state_dict({**whole, "state": state if self._steps else {}})


def _first_step(optimizer: torch.optim.Optimizer) -> dict[str, Any]:
    for group in optimizer.param_groups:
        for parameter in group["params"]:
            parameter.grad = torch.zeros_like(parameter)
    optimizer.step()
    return _state(optimizer)


def _state(optimizer: torch.optim.Optimizer) -> dict[str, Any]:
    """What it keeps of each parameter, by the parameter's number."""
    state = optimizer.state_dict()["state"]
    return {str(k): {n: _on_cpu(v) for n, v in each.items()} for k, each in state.items()}


def _on_cpu(value: Any) -> Any:
    return value.detach().clone().cpu() if isinstance(value, Tensor) else value


def make_optimizer(settings: Training, parameters: Sequence[nn.Parameter]) -> Optimizer:
    """The optimizer that `training.optimizer` names.

    Args:
        settings: of the training.
        parameters: (policies, …) each.

    Raises:
        InputError: torch has none of that name, or it does not take its options.
    """
    chosen = settings.optimizer
    part = chosen.part
    with chosen.entry.blamed():
        if part.is_stacked:
            made: Optimizer = part.make(parameters, settings)
            return made
    return TorchOptimizer(parameters, lambda own: part.make(own, settings), part.name)


def clip_gradient(gradient: Tensor, maximum: float) -> tuple[Tensor, Tensor]:
    """(…, weights) gradients, each row scaled to a norm of `maximum` at most; the norms before."""
    norm = gradient.norm(dim=-1)
    factor = (maximum / (norm + 1e-6)).clamp_max(1.0)
    return gradient.mul_(factor[..., None]), norm
