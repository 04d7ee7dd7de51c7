"""The policy that plays any network of nodes: its weights come with the package.

They lie in `trainers/weights/pretrained.safetensors`, those for each kind of duplex operation under
its name. The metadata of that file say of each what it was trained on, by which scenario. How
they are made: `make pretrained`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import safetensors
import safetensors.torch
from torch import Tensor

from iout_marl.errors import InputError, warn_once
from iout_marl.policies import Actions, BasePolicy
from iout_marl.scenario import Scenario
from iout_marl.scenario.extent import Extent, outside
from iout_marl.scenario.loading import parse_scenario
from iout_marl.world import State, World
from trainers.factory import make_network
from trainers.networks import ActorCritic
from trainers.runs.checking import check_like
from trainers.runs.folder import readable
from trainers.sizing import check_view
from trainers.trained import TrainedPolicy

#: Of the file of weights; others are refused.
FORMAT = 1
WEIGHTS = Path(__file__).with_name("weights") / "pretrained.safetensors"
#: Kinds of duplex operation by how many nodes an AUV names: one to charge and one to hear, or one.
MODES = {2: "fdd", 1: "tdd"}
#: Differences from the training that a note names.
_NAMED = 5


@dataclass(frozen=True)
class Mode:
    """Weights for one kind of duplex operation.

    Attributes:
        scenario: what they were trained on.
        weights: the `state_dict` of actor and critic.
        extent: from where to where the scenarios of the training reach.
        about: environment steps, seconds, machine and so on, of the training.
    """

    scenario: Scenario
    weights: dict[str, Tensor]
    extent: Extent
    about: dict[str, Any]

    def network(self) -> ActorCritic:
        """The networks, of the sizes of `scenario`."""
        world = World(self.scenario)
        return make_network(world.observer, world.action_sizes, self.scenario.training)


@cache
def load_modes(path: Path = WEIGHTS) -> Mapping[str, Mode]:
    """What a file of weights holds, by kind of duplex operation.

    Raises:
        InputError: it cannot be read, is of another version, or damaged.
    """
    with readable(path), safetensors.safe_open(path, "pt") as file:
        metadata = file.metadata() or {}
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    if metadata.get("format") != str(FORMAT):
        raise InputError(
            f"{path}: is of another version of this software: format {metadata.get('format')}, "
            f"not {FORMAT}"
        )
    modes = {}
    for name in MODES.values():
        if name not in metadata:
            continue
        with readable(path):
            about = json.loads(metadata[name])
            scenario = parse_scenario(path, about.pop("scenario").encode())
            extent = about.pop("extent")
        prefix = f"{name}."
        weights = {k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)}
        mode = Mode(scenario, weights, extent, about)
        check_like(path, weights, mode.network().state_dict())
        modes[name] = mode
    return modes


def mode_for(modes: Mapping[str, Mode], scenario: Scenario, who: str) -> Mode:
    """The weights for the actions of a scenario.

    Args:
        modes: those there are.
        scenario: the scenario.
        who: asks for them, for the message.

    Raises:
        InputError: there are none.
    """
    duplex = scenario.duplex
    mode = modes.get(MODES.get(duplex.part.num_choices, ""))
    if mode is None:
        raise InputError(
            f"{who}: has no weights for duplex.kind {duplex.kind}, whose actions name "
            f"{duplex.part.num_choices} nodes"
        )
    return mode


class Pretrained(BasePolicy):
    """Plays any scenario by weights that were trained on many, none of which it need be.

    Args:
        sampled: draw actions from the policy rather than take the most probable ones.
        path: file of the weights.
    """

    name = "pretrained"

    def __init__(self, *, sampled: bool = False, path: Path = WEIGHTS) -> None:
        self.sampled = sampled
        self._modes = load_modes(path)
        self._policies: dict[str, TrainedPolicy] = {}
        #: Who plays in which world, once it was told what is new there.
        self._known: WeakKeyDictionary[World, TrainedPolicy] = WeakKeyDictionary()

    @property
    def is_deterministic(self) -> bool:
        """Whether it leaves nothing to chance."""
        return not self.sampled

    def act(self, world: World, state: State, rng: np.random.Generator) -> Actions:
        """See `iout_marl.policies.Policy`.

        Raises:
            InputError: there are no weights for actions like those of the scenario.
        """
        policy = self._policy_in(world)
        policy.sampled = self.sampled
        return policy.act(world, state, rng)

    def likely_actions(self, world: World, state: State, number: int) -> Actions:
        """See `TrainedPolicy.likely_actions`.

        Raises:
            InputError: as for `act`.
        """
        return self._policy_in(world).likely_actions(world, state, number)

    def _policy_in(self, world: World) -> TrainedPolicy:
        if world not in self._known:
            self._known[world] = self.policy_for(world.scenario)
        return self._known[world]

    def policy_for(self, scenario: Scenario) -> TrainedPolicy:
        """The weights for the actions of a scenario, as a policy that plays in worlds of any size.

        Raises:
            InputError: there are none, or its AUVs' view has a limit.
        """
        mode = mode_for(self._modes, scenario, self.name)
        observation = mode.scenario.observation.model_dump()
        check_view(self.name, observation, scenario)
        self._tell_of(scenario, mode)
        name = MODES[scenario.duplex.part.num_choices]
        if name not in self._policies:
            network = mode.network()
            network.load_state_dict(mode.weights)
            self._policies[name] = TrainedPolicy(
                network.eval(), self.name, use_mask=True, observation=observation
            )
        return self._policies[name]

    def _tell_of(self, scenario: Scenario, mode: Mode) -> None:
        """Name what the weights have not been trained on, if anything."""
        differences = outside(scenario, mode.extent)
        if differences:
            others = len(differences) - _NAMED
            more = f"; and {others} more" if others > 0 else ""
            warn_once(
                f"{self.name}: {scenario.name} is outside what it was trained on, which makes what "
                f"it does a guess: {'; '.join(differences[:_NAMED])}{more}"
            )


def pretrained(*, sampled: bool = False) -> Pretrained:
    """The policy that comes with the package, for any scenario.

    Args:
        sampled: draw actions from the policy rather than take the most probable ones.
    """
    return Pretrained(sampled=sampled)
