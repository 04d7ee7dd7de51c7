"""Makes the networks that a training names, for the observations and actions of a world."""

from __future__ import annotations

import copy
import math

import numpy as np
import torch
from torch import Tensor, nn

from iout_marl.parts import NetworkSizes
from iout_marl.scenario import Training
from iout_marl.world.observation import Observer, Ranges
from trainers.networks import ActorCritic, Perceptron, Scaler, Unscaled, expand_replicas
from trainers.sets import SetActor, SetCritic


def make_network(
    observer: Observer, action_sizes: tuple[int, ...], settings: Training
) -> ActorCritic:
    """Untrained networks, as `training.network` says, for a world's observations and actions.

    Raises:
        InputError: the network's part is at fault.
    """
    privileged = observer.critic_ranges(central=settings.critic == "central")
    entries = len(observer.agent_ranges.low)
    sizes = NetworkSizes(
        entries,
        entries + (0 if privileged is None else len(privileged.low)),
        action_sizes,
        tuple(observer.node_entries),
        settings,
        observer.layout,
    )
    actor, critic = _actor_and_critic(sizes)
    return ActorCritic(
        _scaler(observer.agent_ranges, settings) if observer.layout is None else Unscaled(),
        action_sizes,
        actor,
        critic,
        None if privileged is None else _scaler(privileged, settings),
        observer.node_entries if settings.node_network and observer.layout is None else None,
        settings.activation,
    )


def _actor_and_critic(sizes: NetworkSizes) -> tuple[nn.Module, nn.Sequential]:
    chosen = sizes.training.network
    part = chosen.part
    with chosen.entry.blamed():
        actor, critic = part.make_actor(sizes), part.make_critic(sizes)
        if isinstance(actor, Perceptron) and isinstance(critic, Perceptron):
            return actor, critic
        if isinstance(actor, SetActor) and isinstance(critic, SetCritic):
            return actor, nn.Sequential(critic, OutputScale())
        for name, module, inputs, outputs in (
            ("actor", actor, sizes.observation_entries, sizes.choices),
            ("critic", critic, sizes.critic_entries, 1),
        ):
            if not isinstance(module, nn.Module):
                raise part.fault(f"its {name} is no torch.nn.Module, but a {type(module).__name__}")
            for lead in ((2,), (2, 3), (2, 1, 3)):
                found = module(torch.zeros(*lead, inputs))
                shape = getattr(found, "shape", None)
                if shape != (*lead, outputs):
                    raise part.fault(
                        f"its {name} makes {shape and tuple(shape)} of {(*lead, inputs)}, "
                        f"not {(*lead, outputs)}"
                    )
                if not found.isfinite().all():
                    raise part.fault(f"its {name} makes numbers that are not finite of zeros")
            if _depends_on_mode(module, inputs):
                raise part.fault(
                    f"its {name} does something else in training than in evaluation (dropout, "
                    "batch statistics): a policy must learn by what it does"
                )
    return PolicyByPolicy(actor), nn.Sequential(PolicyByPolicy(critic), OutputScale())


@torch.no_grad()
def _depends_on_mode(module: nn.Module, inputs: int) -> bool:
    """Whether a module's outputs change with `train` and `eval`, or from call to call."""
    sample = torch.linspace(-1.0, 1.0, 4 * inputs).reshape(4, inputs)
    with torch.random.fork_rng(devices=[]):
        trained, again, evaluated = (
            copy.deepcopy(module).train(mode)(sample) for mode in (True, True, False)
        )
    # Rounding may differ: torch evaluates some modules by other ways than it trains them.
    return not all(torch.allclose(trained, each, 1e-3, 1e-4) for each in (again, evaluated))


def _scaler(ranges: Ranges, settings: Training) -> Scaler:
    entries = len(ranges.low)
    shift, scale, limit = np.zeros(entries), np.ones(entries), math.inf
    if settings.observation_scaling == "fixed":
        shift, scale, limit = ranges.low, ranges.scale, ranges.limit
    elif settings.observation_scaling == "running":
        limit = 10.0
    return Scaler(
        torch.from_numpy(shift),
        torch.from_numpy(scale),
        limit,
        running=settings.observation_scaling == "running",
    )


class OutputScale(nn.Module):
    """Multiplies a lone output and adds to it: what PopArt changes of a critic from outside."""

    def __init__(self) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.ones(1))
        self.bias = nn.Parameter(torch.zeros(1))

    def forward(self, value: Tensor) -> Tensor:
        """(…, 1) to (…, 1)."""
        weight, bias = self.weight.squeeze(-1), self.bias.squeeze(-1)
        return value * expand_replicas(weight, value) + expand_replicas(bias, value)


class PolicyByPolicy(nn.Module):
    """Runs a module from outside, whose weights may be `stacked`, for one policy after the other.

    Args:
        module: as it is for one policy.
    """

    def __init__(self, module: nn.Module) -> None:
        super().__init__()
        self.module = module
        self._axes = {name: tensor.ndim for name, tensor in self._tensors().items()}

    def _tensors(self) -> dict[str, Tensor]:
        return {**dict(self.module.named_parameters()), **dict(self.module.named_buffers())}

    def forward(self, inputs: Tensor) -> Tensor:
        """(…, entries) to (…, outputs)."""
        tensors = self._tensors()
        if all(tensor.ndim == self._axes[name] for name, tensor in tensors.items()):
            result: Tensor = self.module(inputs)
            return result
        results = [
            torch.func.functional_call(
                self.module,
                {
                    # Buffers that are not saved are those of every policy.
                    name: tensor[i] if tensor.ndim > self._axes[name] else tensor
                    for name, tensor in tensors.items()
                },
                (each,),
            )
            for i, each in enumerate(inputs)
        ]
        return torch.stack(results)
