"""Adam (Kingma and Ba, 2015) on all weights at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn

DECAYS = (0.9, 0.999)


class Adam:
    """Adam, with the gradients of a network, or of several, in one row each.

    One row for all weights makes their norm, the sum over processes and the steps one
    operation each; and `torch.optim` takes a second to load, a third of the time that a
    training takes to start.

    Args:
        parameters: (…) each, or (replicas, …).
        epsilon: added to the root of the second moment.
        replicas: axis of the policies, where there are several.
        is_recorded: count the steps where the weights are, for steps that are replayed.
    """

    def __init__(
        self,
        parameters: Sequence[nn.Parameter],
        epsilon: float,
        replicas: tuple[int, ...] = (),
        *,
        is_recorded: bool = False,
    ) -> None:
        self._parameters = list(parameters)
        self._epsilon = epsilon
        self._axes = len(replicas)
        self._sizes = [p[0].numel() if replicas else p.numel() for p in self._parameters]
        like = self._parameters[0]
        shape = (*replicas, sum(self._sizes))
        #: Moments of the gradient, (weights) or (replicas, weights).
        self.first = torch.zeros(shape, dtype=like.dtype, device=like.device)
        self.second = torch.zeros_like(self.first)
        #: Steps taken: a number, or () float64 beside the weights.
        self.steps: int | Tensor = 0
        if is_recorded:
            self.steps = torch.zeros((), dtype=torch.float64, device=like.device)

    def gradient(self) -> Tensor:
        """The gradients of all weights, (weights) or (replicas, weights); they are let go of."""
        rows = []
        for parameter in self._parameters:
            assert parameter.grad is not None
            rows.append(parameter.grad.flatten(self._axes))
            parameter.grad = None
        return torch.cat(rows, dim=-1)

    @torch.no_grad()
    def step(self, gradient: Tensor, learning_rate: float | Tensor) -> None:
        """Take a step along a `gradient`; the learning rate is a number, or () float64."""
        self.steps += 1
        first_decay, second_decay = DECAYS
        self.first.lerp_(gradient, 1 - first_decay)
        self.second.mul_(second_decay).addcmul_(gradient, gradient, value=1 - second_decay)
        spread = (self.second / (1 - second_decay**self.steps)).sqrt_().add_(self._epsilon)
        change = (self.first / spread).mul_(-learning_rate / (1 - first_decay**self.steps))
        parts = torch.split(change, self._sizes, dim=-1)
        for parameter, part in zip(self._parameters, parts, strict=True):
            parameter.add_(part.view_as(parameter))

    def state_dict(self, policy: int = 0) -> dict[str, Any]:
        """What `load_state_dict` goes on from, for one policy."""
        first, second = (
            (moment[policy] if self._axes else moment).clone()
            for moment in (self.first, self.second)
        )
        return {"first": first, "second": second, "steps": int(self.steps)}

    def load_state_dict(self, saved: Sequence[dict[str, Any]]) -> None:
        """Go on from the `state_dict` of each policy."""
        for name, moment in (("first", self.first), ("second", self.second)):
            moment.copy_(torch.stack([one[name] for one in saved]).view_as(moment))
        if isinstance(self.steps, Tensor):
            self.steps.fill_(saved[0]["steps"])
        else:
            self.steps = saved[0]["steps"]


def clipped(gradient: Tensor, maximum: float) -> tuple[Tensor, Tensor]:
    """(…, weights) gradients, each row scaled to a norm of `maximum` at most; the norms before."""
    norm = gradient.norm(dim=-1)
    factor = (maximum / (norm + 1e-6)).clamp_max(1.0)
    return gradient.mul_(factor[..., None]), norm
