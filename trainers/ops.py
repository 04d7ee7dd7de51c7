"""The two functions that a training step spends its time in, with gradients by hand.

Both keep the samples along the last axis of memory, where the processor takes many at once,
and write over what they have made themselves. Beside each stands the plain function that it
computes, `reference_…`, which autograd differentiates and the tests compare it with.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from iout_marl.machine import is_by_intel

#: Choices less probable than this have no share in gradient and entropy, where it would be
#: lost in the rounding; numbers that underflow cost a processor ten times the time of others.
_LEAST_LOG_PROBABILITY = -60.0
_LEAST_PROBABILITY = 1e-25


def perceptron(inputs: Tensor, parameters: Sequence[Tensor], activation: str) -> Tensor:
    """A multi-layer perceptron.

    Args:
        inputs: (…, entries, samples).
        parameters: weight (…, outputs, inputs) and bias (…, outputs) of each layer in turn.
            The axes before are those of networks side by side; the inputs have the same.
        activation: `tanh` or `relu`, between the layers.

    Returns:
        (…, outputs, samples).
    """
    if not torch.is_grad_enabled():
        return _layers(inputs, parameters, activation)[1]
    result: Tensor = _Perceptron.apply(activation, inputs, *parameters)  # type: ignore[no-untyped-call]
    return result


def _layers(
    inputs: Tensor, parameters: Sequence[Tensor], activation: str
) -> tuple[list[Tensor], Tensor]:
    """What each layer sees, and the result."""
    seen = [inputs]
    for weight, bias in zip(parameters[::2], parameters[1::2], strict=True):
        result = weight @ seen[-1]
        result += bias[..., None]
        if len(seen) < len(parameters) // 2:
            seen.append(tanh_(result) if activation == "tanh" else result.relu_())
    return seen, result


def tanh_(values: Tensor) -> Tensor:
    """The hyperbolic tangent, in place of the values, within two units of 1's last digit."""
    if values.device.type != "cpu" or not _has_slow_tanh():
        return values.tanh_()
    return values.mul_(2).sigmoid_().mul_(2).sub_(1)


@functools.cache
def _has_slow_tanh() -> bool:
    """Whether tanh takes three times as long as the sigmoid: MKL has it fast for Intel's alone."""
    has_mkl = torch.backends.mkl.is_available()  # type: ignore[no-untyped-call]
    return bool(has_mkl) and not is_by_intel()


def reference_perceptron(inputs: Tensor, parameters: Sequence[Tensor], activation: str) -> Tensor:
    """`perceptron`, one layer after the other."""
    result = inputs
    for i in range(0, len(parameters), 2):
        result = parameters[i] @ result + parameters[i + 1][..., None]
        if i + 2 < len(parameters):
            result = result.tanh() if activation == "tanh" else result.relu()
    return result


def _through_tanh(gradient: Tensor, result: Tensor, grad_input: Tensor) -> None:
    torch.ops.aten.tanh_backward.grad_input(gradient, result, grad_input=grad_input)


def _through_relu(gradient: Tensor, result: Tensor, grad_input: Tensor) -> None:
    torch.ops.aten.threshold_backward.grad_input(gradient, result, 0, grad_input=grad_input)


_through = {"tanh": _through_tanh, "relu": _through_relu}


class _Perceptron(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, activation: str, inputs: Tensor, *parameters: Tensor) -> Tensor:
        # A product of matrices takes less time than a batch of one.
        ctx.is_lone = inputs.ndim == 3 and len(inputs) == 1
        if ctx.is_lone:
            inputs = inputs.squeeze(0)
            parameters = tuple(each.squeeze(0) for each in parameters)
        seen, result = _layers(inputs, parameters, activation)
        ctx.activation = activation
        ctx.save_for_backward(*seen, *parameters[::2])
        return result[None] if ctx.is_lone else result

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        depth = len(ctx.saved_tensors) // 2
        seen, weights = ctx.saved_tensors[:depth], ctx.saved_tensors[depth:]
        if ctx.is_lone:
            gradient = gradient.squeeze(0)
        by_parameter: list[Tensor] = []
        by_inputs = None
        for layer in reversed(range(depth)):
            by_parameter += [gradient.sum(-1), gradient @ seen[layer].mT]
            if layer > 0:
                gradient = weights[layer].mT @ gradient
                _through[ctx.activation](gradient, seen[layer], grad_input=gradient)
            elif ctx.needs_input_grad[1]:
                by_inputs = weights[0].mT @ gradient
        gradients = (by_inputs, *reversed(by_parameter))
        if ctx.is_lone:
            gradients = tuple(None if each is None else each[None] for each in gradients)
        return None, *gradients


class PolicyLoss(NamedTuple):
    """The loss of the actor and what it is made of, (…,) each; only `loss` has a gradient."""

    loss: Tensor  # policy_loss − c · entropy
    policy_loss: Tensor  # −mean of min(r Â, clip(r) Â)
    entropy: Tensor  # mean over samples of the sum over an action's entries
    kl: Tensor  # mean of (r − 1) − log r
    clip_fraction: Tensor  # share of ratios that were clipped


def policy_loss(
    logits: Tensor,
    action: Tensor,
    log_probability: Tensor,
    advantage: Tensor,
    clip: float,
    entropy_coefficient: float,
    samples: int,
) -> PolicyLoss:
    """The clipped surrogate (Schulman et al., 2017) with its entropy bonus.

    Args:
        logits: (…, samples, action entries, width) unnormalised log-probabilities.
        action: (…, samples, action entries) int, the choices made.
        log_probability: (…, samples) of these, by the policy that made them.
        advantage: (…, samples) Â.
        clip: how far from 1 a ratio r counts.
        entropy_coefficient: c.
        samples: what the means divide by: all samples of the minibatch, of which those
            given may be a part.
    """
    return PolicyLoss(
        *_PolicyLoss.apply(  # type: ignore[no-untyped-call]
            logits.movedim(-3, -1),
            action.movedim(-2, -1),
            log_probability,
            advantage,
            clip,
            entropy_coefficient,
            samples,
        )
    )


def reference_policy_loss(
    logits: Tensor,
    action: Tensor,
    log_probability: Tensor,
    advantage: Tensor,
    clip: float,
    entropy_coefficient: float,
    samples: int,
) -> PolicyLoss:
    """`policy_loss`, as its paper states it."""
    log_p = logits.log_softmax(-1)
    log_ratio = log_p.gather(-1, action[..., None]).squeeze(-1).sum(-1) - log_probability
    ratio = log_ratio.exp()
    clipped = ratio.clamp(1 - clip, 1 + clip)
    surrogate = -torch.minimum(ratio * advantage, clipped * advantage).sum(-1) / samples
    entropy = -(log_p.exp() * log_p).sum((-3, -2, -1)) / samples
    return PolicyLoss(
        surrogate - entropy_coefficient * entropy,
        surrogate,
        entropy,
        (ratio - 1 - log_ratio).sum(-1) / samples,
        (ratio != clipped).to(ratio.dtype).sum(-1) / samples,
    )


class _PolicyLoss(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        logits: Tensor,  # (…, entries, width, samples)
        action: Tensor,  # (…, entries, samples)
        before: Tensor,
        advantage: Tensor,
        clip: float,
        entropy_coefficient: float,
        samples: int,
    ) -> tuple[Tensor, ...]:
        chosen = action[..., None, :]
        log_p = logits.log_softmax(-2)
        log_ratio = log_p.gather(-2, chosen).sum((-3, -2)) - before
        log_p.clamp_min_(_LEAST_LOG_PROBABILITY)
        p = torch.threshold_(log_p.exp(), _LEAST_PROBABILITY, 0.0)
        ratio = log_ratio.exp()
        clipped = ratio.clamp(1 - clip, 1 + clip)
        free, bounded = ratio * advantage, clipped * advantage
        entropy = -(p * log_p).sum(-2)
        # ∂H/∂logit = −p (log p + H). Of the surrogate, where it is not clipped:
        # −∂(r Â)/∂logit = −r Â (1[chosen] − p).
        by_ratio = torch.where(free <= bounded, free, 0.0)[..., None, None, :] / -samples
        gradient = log_p.add_(entropy[..., None, :]).mul_(p).mul_(entropy_coefficient / samples)
        gradient.addcmul_(p, by_ratio.expand_as(p), value=-1.0)
        gradient.scatter_add_(-2, chosen, by_ratio.expand_as(chosen))
        ctx.save_for_backward(gradient)
        surrogate = -torch.minimum(free, bounded).sum(-1) / samples
        mean_entropy = entropy.sum((-2, -1)) / samples
        results = (
            surrogate - entropy_coefficient * mean_entropy,
            surrogate,
            mean_entropy,
            (ratio - 1 - log_ratio).sum(-1) / samples,
            (ratio != clipped).to(ratio.dtype).sum(-1) / samples,
        )
        ctx.mark_non_differentiable(*results[1:])
        return results

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, by_loss: Tensor, *others: Tensor) -> tuple[Tensor | None, ...]:  # noqa: ARG004
        (gradient,) = ctx.saved_tensors
        return gradient * by_loss[..., None, None, None], None, None, None, None, None, None
