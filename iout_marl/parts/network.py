"""What a policy's actor and critic are made of."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

from iout_marl.core.table import TableLayout
from iout_marl.parts.base import Part
from iout_marl.registry import Registry
from iout_marl.scenario import Training


@dataclass(frozen=True)
class NetworkSizes:
    """What goes in and comes out of the networks of a policy.

    Attributes:
        observation_entries: of an AUV's observation, which the actor sees.
        critic_entries: of what the critic sees: the observation, and behind it what the critic
            alone sees.
        action_sizes: number of choices of each entry of an action.
        node_entries: where an observation has the age, and the energy, of each node.
        table: how an observation that is a node table is laid out; None of others.
        training: settings of the training.
    """

    observation_entries: int
    critic_entries: int
    action_sizes: tuple[int, ...]
    node_entries: tuple[slice, ...]
    training: Training
    table: TableLayout | None = None

    @property
    def choices(self) -> int:
        """Logits that an actor gives: those of each entry of an action, one after the other."""
        return sum(self.action_sizes)


class Network(Part, ABC):
    """Makes the actor and the critic of a policy, shared by all AUVs.

    Both are a `torch.nn.Module` of float32 inputs, scaled as `training.observation_scaling` says.
    The number of axes before the entries differs from call to call. Weights are drawn from torch's
    global generator.
    """

    is_of_world: ClassVar[bool] = False
    #: Whether its weights serve node tables of any size.
    is_for_any_size: ClassVar[bool] = False

    @abstractmethod
    def make_actor(self, sizes: NetworkSizes) -> Any:
        """(…, observation entries) to (…, choices): logits, before masks."""

    @abstractmethod
    def make_critic(self, sizes: NetworkSizes) -> Any:
        """(…, critic entries) to (…, 1): the value, in standard deviations from the mean return."""


networks: Registry[type[Network]] = Registry("network", Network)
