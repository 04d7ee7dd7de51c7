"""Operations of `trainers.sets`, with gradients by hand: few passes over memory.

Beside each stands the plain function that it computes, `reference_…`, which autograd
differentiates and the tests compare it with. Arrays have the samples last, and before all other
axes those of networks side by side, if any.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable


def mixed(
    weight: Tensor,
    bias: Tensor,
    inputs: Sequence[Tensor],
    *,
    relu: bool = False,
    onto: Tensor | None = None,
) -> Tensor:
    """A linear layer of several inputs whose rows broadcast: A x + B y + … + bias.

    Args:
        weight: (…, outputs, features of all inputs).
        bias: (…, outputs).
        inputs: (…, features, rows…, samples) each, with the same number of axes; the first has
            all the rows, each other one those of the input before it, or 1 where that has several.
        relu: whether negative numbers become 0.
        onto: what the result is added to, after that.

    Returns:
        (…, outputs, rows…, samples).
    """
    if not torch.is_grad_enabled():
        return _mix(weight, bias, inputs, relu=relu, onto=onto)
    result: Tensor = _Mixed.apply(relu, onto, weight, bias, *inputs)  # type: ignore[no-untyped-call]
    return result


def reference_mixed(
    weight: Tensor,
    bias: Tensor,
    inputs: Sequence[Tensor],
    *,
    relu: bool = False,
    onto: Tensor | None = None,
) -> Tensor:
    """`mixed`, one operation after the other."""
    axis = weight.ndim - 2
    rows = inputs[0].shape[axis + 1 :]
    whole = torch.cat([each.expand(*each.shape[: axis + 1], *rows) for each in inputs], dim=axis)
    result = torch.unflatten(weight @ whole.flatten(axis + 1) + bias[..., None], -1, rows)
    result = result.relu() if relu else result
    return result if onto is None else onto + result


def _mix(
    weight: Tensor, bias: Tensor, inputs: Sequence[Tensor], *, relu: bool, onto: Tensor | None
) -> Tensor:
    axis = weight.ndim - 2
    weights = torch.split(weight, [each.shape[axis] for each in inputs], dim=-1)
    result = bias.reshape(*bias.shape, *(1,) * (inputs[0].ndim - axis - 1))
    # From the input of the fewest rows to that of the most.
    for its_weight, each in zip(reversed(weights), reversed(inputs), strict=True):
        product = its_weight @ each.flatten(axis + 1)
        result = torch.unflatten(product, -1, each.shape[axis + 1 :]).add_(result)
    if relu:
        result.relu_()
    return result if onto is None else result.add_(onto)


class _Mixed(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        relu: bool,  # noqa: FBT001 (apply takes no keywords)
        onto: Tensor | None,
        weight: Tensor,
        bias: Tensor,
        *inputs: Tensor,
    ) -> Tensor:
        assert not (relu and onto is not None), "what is added hides what relu has made 0"
        result = _mix(weight, bias, inputs, relu=relu, onto=onto)
        ctx.save_for_backward(weight, result if relu else None, *inputs)
        return result

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        weight, result, *inputs = ctx.saved_tensors
        axis = weight.ndim - 2
        weights = torch.split(weight, [each.shape[axis] for each in inputs], dim=-1)
        by = gradient
        if result is not None:
            by = torch.ops.aten.threshold_backward(gradient, result, 0)
        by_weights, by_inputs = [], []
        for i, (its_weight, each) in enumerate(zip(weights, inputs, strict=True)):
            fewer = [d for d in range(axis + 1, by.ndim) if each.shape[d] < by.shape[d]]
            if fewer:
                by = by.sum(fewer, keepdim=True)
            by_result = by.flatten(axis + 1)
            by_weights.append(by_result @ each.flatten(axis + 1).mT)
            is_needed = ctx.needs_input_grad[4 + i]
            by_inputs.append((its_weight.mT @ by_result).reshape(each.shape) if is_needed else None)
        by_bias = by.flatten(axis + 1).sum(-1)
        by_onto = gradient if ctx.needs_input_grad[1] else None
        return None, by_onto, torch.cat(by_weights, dim=-1), by_bias, *by_inputs


def pooled(rows: Tensor, share: Tensor | None, replicas: int) -> Tensor:
    """Maximum and mean over rows, or maximum and weighted means.

    Args:
        rows: (…, features, …, rows, samples).
        share: (…, heads, …, rows, samples), which is 1 in sum over rows; each weighs an equal part
            of the features. None for equal weights.
        replicas: how many axes are those of networks.

    Returns:
        (…, 2 features, …, 1, samples).
    """
    if not torch.is_grad_enabled():
        return reference_pooled(rows, share, replicas)
    result: Tensor = _Pooled.apply(rows, share, replicas)  # type: ignore[no-untyped-call]
    return result


def reference_pooled(rows: Tensor, share: Tensor | None, replicas: int) -> Tensor:
    """`pooled`, one operation after the other."""
    most = rows.amax(-2, keepdim=True)
    if share is None:
        mean = rows.mean(-2, keepdim=True)
    else:
        split = torch.unflatten(rows, replicas, (share.shape[replicas], -1))
        weighted = (split * share.unsqueeze(replicas + 1)).sum(-2, keepdim=True)
        mean = weighted.flatten(replicas, replicas + 1)
    return torch.cat([most, mean], dim=replicas)


class _Pooled(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, rows: Tensor, share: Tensor | None, replicas: int) -> Tensor:
        result = reference_pooled(rows, share, replicas)
        ctx.replicas = replicas
        ctx.save_for_backward(rows, share, result.narrow(replicas, 0, rows.shape[replicas]))
        return result

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        rows, share, most = ctx.saved_tensors
        axis = ctx.replicas
        by_most, by_mean = torch.split(gradient, rows.shape[axis], dim=axis)
        # Of equal maxima each gets the whole: they are numbers that relu has made 0. Comparing
        # into floats takes a fraction of the time that booleans take.
        by_rows = torch.eq(rows, most, out=torch.empty_like(rows)).mul_(by_most)
        if share is None:
            return by_rows.add_(by_mean / rows.shape[-2]), None, None
        split = (share.shape[axis], -1)
        by_mean = torch.unflatten(by_mean, axis, split)
        torch.unflatten(by_rows, axis, split).addcmul_(by_mean, share.unsqueeze(axis + 1))
        by_share = (torch.unflatten(rows, axis, split) * by_mean).sum(axis + 1)
        return by_rows, by_share, None
