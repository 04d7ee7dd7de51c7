"""Actor and critic, and how they see observations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn

#: A log-probability that comes out as a probability of exactly 0, and is finite.
_IMPOSSIBLE = -1e9
_ACTIVATIONS: dict[str, type[nn.Module]] = {"tanh": nn.Tanh, "relu": nn.ReLU}


class Scaler(nn.Module):
    """Shifts, divides and clamps the inputs of the networks; travels with their weights.

    Args:
        shift, scale: (entries,) each; `running` replaces them by what it sees.
        limit: bound of the result on both sides.
        running: follow mean and spread of the observations seen in training.
    """

    shift: Tensor
    scale: Tensor
    limit: Tensor
    count: Tensor

    def __init__(
        self, shift: Tensor, scale: Tensor, limit: float, *, running: bool = False
    ) -> None:
        super().__init__()
        self.running = running
        self.register_buffer("shift", shift.float().clone())
        self.register_buffer("scale", scale.float().clone())
        self.register_buffer("limit", torch.tensor(float(limit)))
        self.register_buffer("count", torch.tensor(0.0))

    def forward(self, observation: Tensor) -> Tensor:
        """(…, entries) scaled."""
        scaled = (observation - self.shift) / self.scale
        return torch.maximum(torch.minimum(scaled, self.limit), -self.limit)

    @torch.no_grad()
    def update(self, observation: Tensor) -> None:
        """Take in a batch of (…, entries) observations; without effect unless `running`.

        Chan, Golub and LeVeque's rule for merging means and variances.
        """
        if not self.running:
            return
        batch = observation.reshape(-1, observation.shape[-1])
        number = batch.shape[0]
        mean, variance = batch.mean(0), batch.var(0, correction=0)
        total = self.count + number
        delta = mean - self.shift
        old_variance = torch.where(self.count > 0, self.scale**2, variance)
        merged = (
            old_variance * self.count
            + variance * number
            + delta**2 * (self.count > 0) * self.count * number / total
        ) / total
        self.shift += delta * torch.where(self.count > 0, number / total, torch.tensor(1.0))
        self.scale.copy_(merged.clamp_min(1e-8).sqrt())
        self.count.copy_(total)


def perceptron(
    inputs: int, hidden_units: Sequence[int], outputs: int, activation: str, output_gain: float
) -> nn.Sequential:
    """A multi-layer perceptron with orthogonal weights and zero biases."""
    layers: list[nn.Module] = []
    sizes = [inputs, *hidden_units]
    for size_in, size_out in pairwise(sizes):
        layers += [_linear(size_in, size_out, math.sqrt(2)), _ACTIVATIONS[activation]()]
    layers.append(_linear(sizes[-1], outputs, output_gain))
    return nn.Sequential(*layers)


def _linear(inputs: int, outputs: int, gain: float) -> nn.Linear:
    layer = nn.Linear(inputs, outputs)
    nn.init.orthogonal_(layer.weight, gain)
    nn.init.zeros_(layer.bias)
    return layer


class ActorCritic(nn.Module):
    """A multi-categorical actor and a critic, shared by all AUVs.

    The critic works on normalised returns, so that neither their mean nor their scale
    drowns the gradient of the actor. It sees an AUV's observation (IPPO: de Witt et al.,
    2020), or the state of the whole network beside it (MAPPO: Yu et al., 2022), which the
    actor never sees; with difference rewards also what these are made of.

    Args:
        scaler: what prepares the observations.
        action_sizes: number of choices of each entry of an action.
        hidden_units: width of each hidden layer, of actor and critic alike.
        activation: `tanh` or `relu`.
        privileged: what prepares all that the critic alone sees; None where there is nothing.
        node_entries: entries of an observation that tell of each node: ages, energies. With
            them the actor adds to the score of every node what a small network makes of that
            node's entries: one network for all nodes, which need not learn alone what an old
            node or a full store is worth. None for an actor without it.
    """

    padding: Tensor
    return_mean: Tensor
    return_spread: Tensor
    return_count: Tensor

    def __init__(
        self,
        scaler: Scaler,
        action_sizes: Sequence[int],
        hidden_units: Sequence[int],
        activation: str,
        privileged: Scaler | None = None,
        node_entries: Sequence[slice] | None = None,
    ) -> None:
        super().__init__()
        self.action_sizes = tuple(action_sizes)
        self.width = max(action_sizes)
        inputs = scaler.shift.shape[0]
        self.scaler = scaler
        self.privileged = privileged
        # Small first logits make the first policy all but uniform.
        outputs = len(self.action_sizes) * self.width
        self.actor = perceptron(inputs, hidden_units, outputs, activation, 0.01)
        padding = torch.zeros(len(self.action_sizes), self.width)
        for entry, size in zip(padding, self.action_sizes, strict=True):
            entry[size:] = _IMPOSSIBLE
        self.register_buffer("padding", padding, persistent=False)
        if privileged is not None:
            inputs += privileged.shift.shape[0]
        self.critic = perceptron(inputs, hidden_units, 1, activation, 1.0)
        self.node_entries = node_entries
        if node_entries is not None:
            choices = len(self.action_sizes) - 1
            self.node_actor = perceptron(len(node_entries), (16,), choices, activation, 0.01)
        self.register_buffer("return_mean", torch.tensor(0.0))
        self.register_buffer("return_spread", torch.tensor(1.0))
        self.register_buffer("return_count", torch.tensor(0.0))

    def scores(self, inputs: Tensor, mask: Tensor | None = None) -> Tensor:
        """Unnormalised log-probabilities of all choices, (…, action entries, width).

        Entries with fewer choices than `width`, the largest of `action_sizes`, are filled
        up with choices of no probability: one block serves all entries at once.

        Args:
            inputs: (…, entries) scaled observations.
            mask: (…, choices) bool, the choices of one entry after the other; those
                where it is false get no probability.
        """
        flat: Tensor = self.actor(inputs)
        scores = flat.view(*flat.shape[:-1], *self.padding.shape) + self.padding
        if self.node_entries is not None:
            told = torch.stack([inputs[..., entries] for entries in self.node_entries], dim=-1)
            of_nodes = self.node_actor(told).movedim(-1, -2)
            missing = self.width - of_nodes.shape[-1]
            # Directions are no nodes: nothing is added to their scores.
            scores = scores + nn.functional.pad(of_nodes, (0, missing, 1, 0))
        if mask is None:
            return scores
        allowed = torch.zeros_like(scores, dtype=torch.bool)
        allowed[..., self.padding == 0] = mask
        return scores.masked_fill(~allowed, _IMPOSSIBLE)

    def log_probabilities(self, inputs: Tensor, mask: Tensor | None = None) -> Tensor:
        """`scores`, normalised over the choices of each entry."""
        return self.normalised(self.scores(inputs, mask))

    @staticmethod
    def normalised(scores: Tensor) -> Tensor:
        """The log-probabilities that (…, action entries, width) scores stand for."""
        # Over a short last axis log_softmax takes one number at a time; with the samples
        # last it takes many at once, in a fraction of the time.
        samples_last = scores.movedim((-2, -1), (0, 1)).contiguous()
        return samples_last.log_softmax(1).movedim((0, 1), (-2, -1))

    def critic_inputs(self, inputs: Tensor, seen: Tensor | None) -> Tensor:
        """What the critic sees, (…, entries).

        Args:
            inputs: (…, entries) scaled observations.
            seen: (…, entries) what it alone sees, as the world gives it; None for nothing.
        """
        if self.privileged is None or seen is None:
            return inputs
        return torch.cat([inputs, self.privileged(seen)], dim=-1)

    def normalised_value(self, inputs: Tensor) -> Tensor:
        """Values, (…), of (…, entries) `critic_inputs`, in spreads from the mean return."""
        value: Tensor = self.critic(inputs)
        return value.squeeze(-1)

    def value(self, inputs: Tensor) -> Tensor:
        """Values, (…), of (…, entries) `critic_inputs`."""
        return self.normalised_value(inputs) * self.return_spread + self.return_mean

    def normalised_return(self, returns: Tensor) -> Tensor:
        """Returns in spreads from their mean: what `normalised_value` aims at."""
        return (returns - self.return_mean) / self.return_spread

    @torch.no_grad()
    def follow_returns(self, returns: Tensor, decay: float = 0.9) -> None:
        """Move the critic's normalisation towards the mean and spread of these returns.

        The last layer is changed so that every value stays what it was (PopArt: van
        Hasselt et al., 2016); only the first call, before anything is learnt, moves them.
        """
        decay = decay if self.return_count > 0 else 0.0
        mean = decay * self.return_mean + (1 - decay) * returns.mean()
        spread = decay * self.return_spread + (1 - decay) * returns.std().clamp_min(1e-4)
        last = self.critic[-1]
        assert isinstance(last, nn.Linear)
        if self.return_count > 0:
            last.weight *= self.return_spread / spread
            last.bias.copy_((last.bias * self.return_spread + self.return_mean - mean) / spread)
        self.return_mean.copy_(mean)
        self.return_spread.copy_(spread)
        self.return_count += 1

    @staticmethod
    def choose(scores: Tensor, noise: Tensor | None = None) -> Tensor:
        """(…, action entries): the most probable choices.

        With Gumbel `noise` of the shape of the scores, these are samples.
        """
        return (scores if noise is None else scores + noise).argmax(-1)

    @staticmethod
    def log_probability(log_probabilities: Tensor, action: Tensor) -> Tensor:
        """(…): log-probability of (…, action entries) actions."""
        return log_probabilities.gather(-1, action.unsqueeze(-1)).squeeze(-1).sum(-1)

    @staticmethod
    def entropy(log_probabilities: Tensor) -> Tensor:
        """(…): entropy of the policy, the sum of that of its entries."""
        return -(log_probabilities.exp() * log_probabilities).sum((-2, -1))


def gumbel_noise(shape: Sequence[int], generator: torch.Generator) -> Tensor:
    """Standard Gumbel noise."""
    uniform = torch.rand(*shape, generator=generator, device=generator.device)
    tiny = torch.finfo(uniform.dtype).tiny
    return -(-uniform.clamp_min(tiny).log()).clamp_min(tiny).log()
