"""Means and variances, of a batch that a group of processes shares, and merged over batches."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from trainers.accel.group import ProcessGroup


class Moments(NamedTuple):
    """Mean and variance of a number of values; shapes as their maker says."""

    mean: Tensor
    variance: Tensor
    number: Tensor  # () float

    @classmethod
    def from_values(cls, values: Tensor, dims: tuple[int, ...], group: ProcessGroup) -> Moments:
        """Those of a group's values over some of their axes; float64."""
        values = values.double()
        number = values.new_full((), float(group.size))
        for dim in dims:
            number = number * values.shape[dim]
        mean = group.sum(values.sum(dims)) / number
        kept = mean
        for dim in sorted(d % values.ndim for d in dims):
            kept = kept.unsqueeze(dim)
        variance = group.sum((values - kept).square_().sum(dims)) / number
        return cls(mean, variance, number)

    def merged(self, other: Moments) -> Moments:
        """Those of both (Chan, Golub and LeVeque's rule)."""
        number = self.number + other.number
        delta = other.mean - self.mean
        squares = self.variance * self.number + other.variance * other.number
        squares = squares + delta**2 * self.number * other.number / number
        return Moments(self.mean + delta * other.number / number, squares / number, number)

    @classmethod
    def from_no_values(cls, shape: tuple[int, ...], device: torch.device) -> Moments:
        """Those of no values."""
        zeros = torch.zeros(shape, dtype=torch.float64, device=device)
        return cls(zeros, zeros.clone(), zeros.new_zeros(()))
