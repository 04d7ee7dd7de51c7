"""The minibatches that a rollout's samples are cut into, in a new order in each epoch."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import torch
from torch import Tensor

from iout_marl.scenario import Training
from trainers.accel import Runtime
from trainers.networks import expand_replicas


class Minibatches:
    """Cuts the samples of all processes into minibatches; each process has its own part of them.

    Args:
        settings: how many minibatches, and whether advantages are normalised.
        num_auvs: samples of one environment in one slot.
        generators: the stream of each policy, from which the orders are drawn.
        runtime: the processes.
    """

    def __init__(
        self,
        settings: Training,
        num_auvs: int,
        generators: Sequence[torch.Generator],
        runtime: Runtime,
    ) -> None:
        self._settings = settings
        self._row = settings.environments * num_auvs  # samples of one slot, of all processes
        self._generators = generators
        self._runtime = runtime

    def orders(self, slots: int, epochs: int) -> Iterator[Tensor]:
        """A new order of the samples of so many slots for each epoch: (policies, samples)."""
        for _ in range(epochs):
            orders = [
                torch.randperm(slots * self._row, generator=each, device=self._runtime.device)
                for each in self._generators
            ]
            yield torch.stack(orders)

    def cut(
        self, data: Mapping[str, Tensor], order: Tensor
    ) -> Iterator[tuple[dict[str, Tensor], int]]:
        """This process's part of each minibatch, and how many samples the whole one has.

        Args:
            data: (policies, samples, …) each; an `advantage` is normalised over each minibatch.
            order: (policies, samples), as by `orders`.
        """
        # Of all policies' samples as one long table, found by one index in place of two.
        policies, samples = order.shape
        rows = order + samples * torch.arange(policies, device=order.device)[:, None]
        parts = rows.tensor_split(self._settings.minibatches, dim=-1)
        minibatches = [(self._own(index), index.shape[-1]) for index in parts]
        advantages = self._advantages(data["advantage"], minibatches)
        for (index, number), advantage in zip(minibatches, advantages, strict=True):
            others = {k: _take(v, index) for k, v in data.items() if k != "advantage"}
            yield {**others, "advantage": advantage}, number

    def _own(self, index: Tensor) -> Tensor:
        """This process's part of (policies, samples) indices into all, as it counts its samples."""
        group = self._runtime.group
        if group.size == 1:
            return index
        own = group.share(self._row)
        slot, place = index // self._row, index % self._row
        is_own = (place >= own.start) & (place < own.stop)
        # Several processes train one policy.
        return (slot * (own.stop - own.start) + place - own.start)[is_own][None]

    def _advantages(
        self, advantage: Tensor, minibatches: Sequence[tuple[Tensor, int]]
    ) -> list[Tensor]:
        """Those of each minibatch, with mean 0 and standard deviation 1 over all its samples."""
        parts = [_take(advantage, index) for index, _ in minibatches]
        if not self._settings.normalise_advantage:
            return parts
        exact = [part.double() for part in parts]
        sums = torch.stack([torch.stack([e.sum(-1), e.square().sum(-1)]) for e in exact])
        normalised = []
        for part, (total, squares), (_, samples) in zip(
            parts, self._runtime.sum(sums), minibatches, strict=True
        ):
            if samples > 1:
                mean = total / samples
                std = ((squares - samples * mean**2) / (samples - 1)).clamp_min(0).sqrt()
                mean, std = mean.float(), std.float() + 1e-8
                part = (part - expand_replicas(mean, part)) / expand_replicas(std, part)  # noqa: PLW2901
            normalised.append(part)
        return normalised


def _take(values: Tensor, index: Tensor) -> Tensor:
    """The (policies, samples, …) values at indices, (policies, samples), into all samples."""
    found = values.flatten(0, 1).index_select(0, index.flatten())
    return found.reshape(*index.shape, *values.shape[2:])
