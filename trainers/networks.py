"""Actor and critic, and how they see observations.

Networks of several policies can be `stacked` into one, whose weights have one more axis, the
first; so have then all that goes in and comes out: (policies, …) instead of (…).
"""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, Self

import torch
from torch import Tensor, nn

from iout_marl.core.table import TableLayout
from trainers import ops
from trainers.moments import Moments
from trainers.stepwise import StepwiseActor

#: A log-probability that comes out as a probability of exactly 0, and is finite.
IMPOSSIBLE = -1e9
_ACTIVATIONS: dict[str, type[nn.Module]] = {"tanh": nn.Tanh, "relu": nn.ReLU}


class Scaler(nn.Module):
    """Shifts, divides and clamps the inputs of the networks; travels with their weights.

    Args:
        shift, scale: (entries,) each; `running` replaces them by what it sees.
        limit: bound of the result on both sides.
        running: follow mean and standard deviation of the observations seen in training.
    """

    shift: Tensor
    scale: Tensor
    count: Tensor

    def __init__(
        self, shift: Tensor, scale: Tensor, limit: float, *, running: bool = False
    ) -> None:
        super().__init__()
        self.running = running
        self.limit = limit
        self.register_buffer("shift", shift.float().clone())
        self.register_buffer("scale", scale.float().clone())
        self.register_buffer("count", torch.tensor(0.0))

    def forward(self, observation: Tensor) -> Tensor:
        """(…, entries) scaled."""
        shift, scale = self.shift, self.scale
        if shift.ndim > 1:
            shape = (len(shift), *(1,) * (observation.ndim - 2), -1)
            shift, scale = shift.reshape(shape), scale.reshape(shape)
        return (observation - shift).div_(scale).clamp_(-self.limit, self.limit)

    @torch.no_grad()
    def update(self, seen: Moments) -> None:
        """Take in the moments, (entries,), of observations; without effect unless `running`."""
        if not self.running:
            return
        before = Moments(
            self.shift.double(), self.scale.double() ** 2, self.count[..., None].double()
        )
        merged = before.merged(seen)
        self.shift.copy_(merged.mean)
        self.scale.copy_(merged.variance.clamp_min(1e-8).sqrt())
        self.count.copy_(merged.number[..., 0])


class Unscaled(Scaler):
    """Leaves node tables, of any size, as they are: their numbers are of order one anywhere."""

    def __init__(self) -> None:
        super().__init__(torch.zeros(1), torch.ones(1), math.inf)

    def forward(self, observation: Tensor) -> Tensor:
        """(…, entries) as they are."""
        return observation


class Perceptron(nn.Sequential):
    """Linear layers with an activation between them; see `ops.perceptron`."""

    def __init__(self, layers: Sequence[nn.Module], activation: str) -> None:
        super().__init__(*layers)
        self._activation = activation
        #: Weight and bias of each layer: modules take their time to look for them.
        self._in_order = list(self.parameters())
        self._of_lone: list[Tensor] = []

    def forward(self, inputs: Tensor) -> Tensor:
        """(…, entries) to (…, outputs), whose samples lie along the last axis of memory."""
        parameters: Sequence[Tensor] = self._in_order
        if parameters[0].shape[:-2] == (1,) and not torch.is_grad_enabled():
            parameters = self._lone_parameters()
        replicas = inputs.shape[: parameters[0].ndim - 2]
        samples = inputs.reshape(*replicas, -1, inputs.shape[-1]).mT
        result = ops.perceptron(samples, parameters, self._activation).mT
        return result.reshape(*inputs.shape[:-1], result.shape[-1])

    def _lone_parameters(self) -> list[Tensor]:
        """The parameters of a lone policy without the axis of policies: matrices take less time."""
        first = self._in_order[0]
        if not self._of_lone or self._of_lone[0].data_ptr() != first.data_ptr():
            self._of_lone = [parameter.detach()[0] for parameter in self._in_order]
        return self._of_lone


def perceptron(
    inputs: int, hidden_units: Sequence[int], outputs: int, activation: str, output_gain: float
) -> Perceptron:
    """A multi-layer perceptron with orthogonal weights and zero biases."""
    layers: list[nn.Module] = []
    sizes = [inputs, *hidden_units]
    for size_in, size_out in pairwise(sizes):
        layers += [_linear(size_in, size_out, math.sqrt(2)), _ACTIVATIONS[activation]()]
    layers.append(_linear(sizes[-1], outputs, output_gain))
    return Perceptron(layers, activation)


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
        actor: (…, entries) to the logits of all choices: either (…, choices), those of one entry
            of an action after the other, or (…, action entries · width), see `logits`.
        critic: (…, entries) to (…, 1); its last layer has a `weight` and a `bias`.
        privileged: what prepares all that the critic alone sees; None where there is nothing.
        node_entries: entries of an observation that tell of each node: ages, energies. With
            them the actor adds to the logit of every node what a small network makes of that
            node's entries: one network for all nodes, which need not learn alone what an old
            node or a full store is worth. None for an actor without it.
        activation: of that small network.
    """

    padding: Tensor
    choice: Tensor
    return_mean: Tensor
    return_std: Tensor
    return_count: Tensor

    def __init__(
        self,
        scaler: Scaler,
        action_sizes: Sequence[int],
        actor: nn.Module,
        critic: nn.Sequential,
        privileged: Scaler | None = None,
        node_entries: Sequence[slice] | None = None,
        activation: str = "tanh",
    ) -> None:
        super().__init__()
        self.action_sizes = tuple(action_sizes)
        self.width = max(action_sizes)
        self.scaler = scaler
        self.privileged = privileged
        self.actor = actor
        padding = torch.zeros(len(self.action_sizes), self.width)
        for entry, size in zip(padding, self.action_sizes, strict=True):
            entry[size:] = IMPOSSIBLE
        self.register_buffer("padding", padding, persistent=False)
        #: Where in a mask each choice of each entry stands.
        choice = torch.zeros(padding.shape, dtype=torch.int64)
        choice[padding == 0] = torch.arange(sum(self.action_sizes))
        self.register_buffer("choice", choice, persistent=False)
        self.critic = critic
        self.node_entries = node_entries
        if node_entries is not None:
            choices = len(self.action_sizes) - 1
            self.node_actor = perceptron(len(node_entries), (16,), choices, activation, 0.01)
        self.register_buffer("return_mean", torch.tensor(0.0))
        self.register_buffer("return_std", torch.tensor(1.0))
        self.register_buffer("return_count", torch.tensor(0.0))

    @property
    def observation_entries(self) -> int:
        """Entries of an observation."""
        return self.scaler.shift.shape[-1] if self.layout is None else self.layout.size

    @property
    def layout(self) -> TableLayout | None:
        """How the node tables that they see are laid out; None of other observations."""
        layout: TableLayout | None = getattr(self.actor, "layout", None)
        return layout

    def sized_for(self, layout: TableLayout, action_sizes: Sequence[int]) -> Self:
        """These networks for node tables and actions of other sizes; the weights are the same.

        Args:
            layout: of the tables.
            action_sizes: number of choices of each entry of an action.
        """
        actor: Any = self.actor
        first: Any = self.critic[0]
        critic = nn.Sequential(first.sized_for(layout), *list(self.critic)[1:])
        result = type(self)(
            self.scaler, action_sizes, actor.sized_for(layout, action_sizes), critic
        ).to(self.return_mean.device)
        result.return_mean, result.return_std = self.return_mean, self.return_std
        result.return_count = self.return_count
        return result

    def logits(
        self, inputs: Tensor, mask: Tensor | None = None, action: Tensor | None = None
    ) -> Tensor:
        """Unnormalised log-probabilities of all choices, (…, action entries, width).

        Entries with fewer choices than `width`, the largest of `action_sizes`, are filled
        up with choices of no probability: one block serves all entries at once.

        Args:
            inputs: (…, entries) scaled observations.
            mask: (…, choices) bool, the choices of one entry after the other; those
                where it is false get no probability.
            action: (…, action entries) choices, of which a `StepwiseActor` takes those before each
                entry as made; None for the most probable ones.
        """
        if isinstance(self.actor, StepwiseActor):
            return self._stepwise_logits(inputs, mask, action)
        flat: Tensor = self.actor(inputs)
        if flat.shape[-1] == self.padding.numel():
            logits = flat.reshape(*flat.shape[:-1], *self.padding.shape) + self.padding
        else:
            logits = flat[..., self.choice] + self.padding
        if self.node_entries is not None:
            seen = torch.stack([inputs[..., entries] for entries in self.node_entries], dim=-1)
            by_node = self.node_actor(seen).movedim(-1, -2)
            missing = self.width - by_node.shape[-1]
            # Directions are no nodes, nor is nobody: their logits are the actor's own.
            logits = logits + nn.functional.pad(by_node, (0, missing, 1, 0))
        if mask is None:
            return logits
        return logits.masked_fill(~mask[..., self.choice], IMPOSSIBLE)

    @staticmethod
    def log_probabilities(logits: Tensor) -> Tensor:
        """What (…, action entries, width) logits stand for, normalised for each entry."""
        return _samples_last(logits).log_softmax(1).movedim((0, 1), (-2, -1))

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
        """`value`, in standard deviations from the mean return."""
        value: Tensor = self.critic(inputs)
        return value.squeeze(-1)

    def value(self, inputs: Tensor) -> Tensor:
        """Values, (…), of (…, entries) `critic_inputs`."""
        value = self.normalised_value(inputs)
        mean, std = self._return_scale(value)
        return value * std + mean

    def normalised_return(self, returns: Tensor) -> Tensor:
        """Returns in standard deviations from their mean: what `normalised_value` aims at."""
        mean, std = self._return_scale(returns)
        return (returns - mean) / std

    def _return_scale(self, like: Tensor) -> tuple[Tensor, Tensor]:
        return expand_replicas(self.return_mean, like), expand_replicas(self.return_std, like)

    @torch.no_grad()
    def update_popart(self, returns: Moments, decay: float = 0.9) -> None:
        """Move the critic's normalisation towards the mean and variance of returns, () each.

        The last layer is changed so that every value stays what it was (PopArt: van
        Hasselt et al., 2016); only the first call, before anything is learnt, moves them.
        """
        is_first = self.return_count == 0
        decay_now = torch.where(is_first, 0.0, decay)
        mean = decay_now * self.return_mean + (1 - decay_now) * returns.mean.float()
        std = returns.variance.sqrt().clamp_min(1e-4).float()
        std = decay_now * self.return_std + (1 - decay_now) * std
        last: Any = self.critic[-1]
        factor = torch.where(is_first, 1.0, self.return_std / std)
        offset = torch.where(is_first, 0.0, (self.return_mean - mean) / std)
        last.weight *= expand_replicas(factor, last.weight)
        last.bias.copy_(
            last.bias * expand_replicas(factor, last.bias) + expand_replicas(offset, last.bias)
        )
        self.return_mean.copy_(mean)
        self.return_std.copy_(std)
        self.return_count += 1

    @staticmethod
    def greedy_action(logits: Tensor) -> Tensor:
        """(…, action entries): the most probable choices."""
        return logits.argmax(-1)

    def act(self, inputs: Tensor, mask: Tensor | None, uniform: Tensor) -> tuple[Tensor, Tensor]:
        """Actions drawn from the policy, and their log-probability.

        Args:
            inputs, mask: as for `logits`.
            uniform: (…, action entries) numbers of (0, 1], see `sample`.

        Returns:
            (…, action entries) choices and (…) log-probabilities.
        """
        if not isinstance(self.actor, StepwiseActor):
            return self.sample(self.logits(inputs, mask), uniform)
        noise, drawn = self._as_samples(uniform), []

        def draw(entry: int, logits: Tensor) -> Tensor:
            drawn.append(_drawn(logits, noise[..., entry, :]))
            return drawn[-1][0]

        self._decide(inputs, mask, draw)
        choices, log_probabilities = (
            torch.stack(each, dim=-1) for each in zip(*drawn, strict=True)
        )
        lead = inputs.shape[:-1]
        return choices.reshape(*lead, -1), log_probabilities.sum(-1).reshape(lead)

    def _stepwise_logits(
        self, inputs: Tensor, mask: Tensor | None, action: Tensor | None
    ) -> Tensor:
        """`logits` of a `StepwiseActor`."""
        given = None if action is None else self._as_samples(action)
        found: list[Tensor] = []

        def keep(entry: int, logits: Tensor) -> Tensor:
            missing = self.width - logits.shape[-2]
            found.append(nn.functional.pad(logits, (0, 0, 0, missing), value=IMPOSSIBLE))
            return logits.argmax(-2) if given is None else given[..., entry, :]

        self._decide(inputs, mask, keep)
        # (…, action entries, width, samples), of which the samples go to the front.
        logits = torch.stack(found, dim=-3).movedim(-1, -3)
        return logits.reshape(*inputs.shape[:-1], *logits.shape[-2:])

    def _decide(
        self, inputs: Tensor, mask: Tensor | None, choose: Callable[[int, Tensor], Tensor]
    ) -> None:
        """Let a `StepwiseActor` decide: `choose` gets an entry's number and its masked logits."""
        masks = None
        if mask is not None:
            masks = torch.split(self._as_samples(mask), list(self.action_sizes), dim=-2)
        entries = itertools.count()

        def choose_sensibly(logits: Tensor) -> Tensor:
            entry = next(entries)
            if masks is not None:
                logits = logits.masked_fill(~masks[entry], IMPOSSIBLE)
            return choose(entry, logits)

        actor: Any = self.actor
        actor.decide(self._as_samples(inputs), choose_sensibly)

    def _as_samples(self, values: Tensor) -> Tensor:
        """(policies, …, entries), or (…, entries) of a lone policy, with the samples last."""
        replicas = self.return_mean.ndim
        return values.reshape(*values.shape[:replicas], -1, values.shape[-1]).mT

    @staticmethod
    def sample(logits: Tensor, uniform: Tensor) -> tuple[Tensor, Tensor]:
        """Choices drawn by inverting their distribution, and their log-probability.

        Args:
            logits: (…, action entries, width).
            uniform: (…, action entries) numbers of (0, 1]. At 0 the first choice would be
                taken even where it has no probability.

        Returns:
            (…, action entries) choices and (…) log-probabilities.
        """
        probability = _samples_last(logits).softmax(1)
        shares = probability.cumsum(1)
        drawn = shares[:, -1:] * uniform.movedim(-1, 0).unsqueeze(1)
        choice = (shares < drawn).sum(1, keepdim=True)
        log_probability = probability.gather(1, choice).log_().sum((0, 1))
        return choice.squeeze(1).movedim(0, -1), log_probability

    @staticmethod
    def log_probability(log_probabilities: Tensor, action: Tensor) -> Tensor:
        """(…): log-probability of (…, action entries) actions."""
        return log_probabilities.gather(-1, action.unsqueeze(-1)).squeeze(-1).sum(-1)


def _drawn(logits: Tensor, uniform: Tensor) -> tuple[Tensor, Tensor]:
    """As `ActorCritic.sample`, of one entry: (…, choices, samples) logits, (…, samples) others."""
    probability = logits.softmax(-2)
    shares = probability.cumsum(-2)
    choice = (shares < shares[..., -1:, :] * uniform[..., None, :]).sum(-2, keepdim=True)
    return choice.squeeze(-2), probability.gather(-2, choice).squeeze(-2).log()


def stacked(networks: Sequence[ActorCritic]) -> ActorCritic:
    """Networks of one shape as one, whose weights and buffers are (policies, …)."""
    result = copy.deepcopy(networks[0])
    state = [network.state_dict() for network in networks]
    for name, tensor in [*result.named_parameters(), *result.named_buffers()]:
        if name in state[0]:
            tensor.data = torch.stack([one[name] for one in state])
    return result


def expand_replicas(values: Tensor, other: Tensor) -> Tensor:
    """Values (policies) or () in a shape to multiply each policy's part of the other."""
    return values.reshape(*values.shape, *(1,) * (other.ndim - values.ndim))


def _samples_last(logits: Tensor) -> Tensor:
    """(…, action entries, width) as (action entries, width, …).

    Over a short last axis softmax takes one number at a time; with the samples last, as
    they lie in memory, it takes many at once, in a fraction of the time.
    """
    return logits.movedim((-2, -1), (0, 1))


def uniform_noise(shape: Sequence[int], generator: torch.Generator) -> Tensor:
    """Numbers of (0, 1], for `ActorCritic.sample`."""
    return 1 - torch.rand(*shape, generator=generator, device=generator.device)
