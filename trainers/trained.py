"""A trained network as a policy."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from iout_marl.errors import InputError
from iout_marl.policies import Actions, BasePolicy
from iout_marl.policies.forms import Sizes, read_question
from iout_marl.policies.policy import most_probable
from iout_marl.policies.predicting import asked_in, episodes_of, rows_of
from iout_marl.world import State, World
from trainers.agreement import agreed
from trainers.likely import likely_actions, likely_together
from trainers.networks import ActorCritic
from trainers.sizing import SizedNetworks

#: Rows of node tables that are looked at together: what is made of more of them does not fit into a
#: processor's cache.
_ROWS_AT_ONCE = 10_000


class TrainedPolicy(BasePolicy):
    """Plays what a network has learnt.

    AUVs of any number that name a node to hear apart from the node to charge, and see the state
    of the whole network, agree on whom each hears: see `trainers.agreement`.

    Args:
        network: actor and critic, on any device.
        name: what tables call it.
        use_mask: as in its training.
        sampled: draw actions from the policy, as in its training, rather than take the most
            probable ones.
        num_auvs: of the fleet, for `predict`: how many observations are joined end to end; None
            for any number.
        observation: settings of the node table that the networks see; they then play in worlds
            of any size.
    """

    def __init__(
        self,
        network: ActorCritic,
        name: str = "ppo",
        *,
        use_mask: bool = False,
        sampled: bool = False,
        num_auvs: int | None = None,
        observation: dict[str, Any] | None = None,
    ) -> None:
        self.network = network
        self.name = name
        self.use_mask = use_mask
        self.sampled = sampled
        self._num_auvs = num_auvs
        self._sized = None if network.layout is None else SizedNetworks(network, name, observation)

    @property
    def is_deterministic(self) -> bool:
        """Whether it leaves nothing to chance."""
        return not self.sampled

    def act(self, world: World, state: State, rng: np.random.Generator) -> Actions:
        """See `iout_marl.policies.Policy`.

        Raises:
            InputError: the networks have come to numbers that are not finite.
        """
        network, observation, mask, nodes = self._seen(world, state)
        return self._choose(network, observation, mask, rng, nodes)

    @torch.inference_mode()
    def likely_actions(self, world: World, state: State, number: int) -> Actions:
        """What all AUVs together would do, and what else they would most probably do.

        Only the first is agreed upon, see `trainers.agreement`.

        Args:
            world, state: as for `act`.
            number: how many to name: the most probable actions, of which `act` takes the first.

        Returns:
            (envs, number, auvs, entries), fewer where there are no more.
        """
        network, observation, mask, nodes = self._seen(world, state)
        seen, allowed = _as_tensors(network, observation, mask)
        found = [
            likely_together(*likely_actions(network, network.scaler(part), its_mask, number))
            for part, its_mask in _in_parts(network, seen, allowed, rows=number)
        ]
        likely = torch.cat(found).cpu().numpy()
        with most_probable(self):
            own = self._choose(network, observation, mask, np.random.default_rng(), nodes)[:, None]
        # Where it is among them, in the last place, of which there is none for it.
        is_own = (likely == own).all((-1, -2))
        others = np.take_along_axis(
            likely, is_own.argsort(axis=1, kind="stable")[:, : number - 1, None, None], axis=1
        )
        return np.concatenate([own, others], axis=1)

    def _seen(
        self, world: World, state: State
    ) -> tuple[ActorCritic, Any, npt.NDArray[np.bool_] | None, int | None]:
        """What `_choose` takes: the networks as they are in a world, and what they see there."""
        mask = world.action_mask(state) if self.use_mask else None
        if self._sized is None:
            return self.network, world.observe(state), mask, None
        network, observer = self._sized.in_world(world)
        nodes = world.num_nodes if _can_agree(world) else None
        return network, observer.observe(state), mask, nodes

    def predict(
        self,
        observation: Any,
        mask: Any = None,
        *,
        env: Any = None,
        rng: np.random.Generator | None = None,
    ) -> Any:
        """See `BasePolicy.predict`; needs no environment.

        Args:
            observation, mask: as there.
            env: knows the masks, and the seed of what is drawn (`sampled`).
            rng: for actions that are drawn; None for streams by the environment's seed, and
                without an environment for the operating system's entropy.

        Raises:
            InputError: observations of another form or size; or the policy was trained with
                masks, and there is none.
        """
        if self._sized is not None and env is not None:
            # In environments of any size, by the state.
            return super().predict(observation, mask, env=env, rng=rng)
        episodes = None if env is None else episodes_of(env)
        sizes = Sizes(self.network.observation_entries, self.network.action_sizes, self._num_auvs)
        question = read_question(observation, mask, sizes, self.name)
        masks = question.masks if self.use_mask else None
        if self.use_mask and masks is None:
            if episodes is None:
                raise InputError(
                    f"{self.name}: was trained with masks (training.mask_actions): give mask=, "
                    "which environments hand out by observation.action_mask, or env="
                )
            masks = rows_of(episodes.masks(), question, episodes, self.name) != 0
        # Of a whole environment, or batch, all that is drawn has the shape that it has in `act`.
        leading: tuple[int, ...] = (len(question.rows),)
        if episodes is not None:
            world = episodes.world
            if len(question.rows) == world.num_envs * world.num_auvs:
                leading = (world.num_envs, world.num_auvs)
            rng = rng or asked_in(episodes).streams
        rows = question.rows.reshape(*leading, sizes.observation)
        masks = masks if masks is None else masks.reshape(*leading, sum(sizes.action))
        actions = self._choose(self.network, rows, masks, rng or np.random.default_rng())
        return question.answer(actions.reshape(-1, len(sizes.action)))

    @torch.inference_mode()
    def _choose(
        self,
        network: ActorCritic,
        observation: Any,
        mask: npt.NDArray[np.bool_] | None,
        rng: np.random.Generator,
        nodes: int | None = None,
    ) -> Actions:
        """(…, entries) actions for (…, entries) observations and (…, choices) masks.

        Where `nodes`, their number, is given, AUVs agree on whom each hears.
        """
        seen, allowed = _as_tensors(network, observation, mask)
        noise = None
        if self.sampled:
            shape = (*seen.shape[:-1], len(network.action_sizes))
            drawn = 1 - rng.random(shape, dtype=np.float32)
            noise = torch.as_tensor(drawn, device=seen.device)
        actions = [
            self._choose_some(network, part, its_mask, its_draws, nodes)
            for part, its_mask, its_draws in _in_parts(network, seen, allowed, noise)
        ]
        return torch.cat(actions).cpu().numpy()

    def _choose_some(
        self,
        network: ActorCritic,
        seen: Tensor,
        allowed: Tensor | None,
        noise: Tensor | None,
        nodes: int | None,
    ) -> Tensor:
        """`_choose` of a part of the environments, on the networks' device."""
        inputs = network.scaler(seen)
        if noise is not None:
            action, found = network.act(inputs, allowed, noise)
        else:
            found = network.logits(inputs, allowed)
            action = network.greedy_action(found)
        if nodes is not None:
            if noise is not None:
                found = network.logits(inputs, allowed, action)
            heard = network.log_probabilities(found)[..., -1, :]
            action[..., -1] = agreed(action[..., -1], heard, nodes)
        if not found.isfinite().all():
            raise InputError(
                f"{self.name}: its weights lead to numbers that are not finite: they are damaged, "
                "or of a training that diverged"
            )
        return action


def _as_tensors(
    network: ActorCritic, observation: Any, mask: npt.NDArray[np.bool_] | None
) -> tuple[Tensor, Tensor | None]:
    """Observations and masks on the networks' device."""
    device = network.scaler.shift.device
    seen = torch.as_tensor(observation, dtype=torch.float32, device=device)
    return seen, None if mask is None else torch.as_tensor(mask, device=device)


def _in_parts(
    network: ActorCritic, seen: Tensor, *others: Tensor | None, rows: int = 1
) -> Iterator[tuple[Any, ...]]:
    """Environments by parts that fit into a cache: of the observations, and of what lies beside.

    Args:
        network: sees them.
        seen: (envs, …, entries) observations.
        others: (envs, …) or None each.
        rows: by how many rows each observation is looked at.
    """
    at_once = max(len(seen), 1)
    if network.layout is not None and seen.device.type == "cpu":
        looked_at = network.layout.nodes * seen.shape[1:-1].numel() * rows
        at_once = max(_ROWS_AT_ONCE // looked_at, 1)
    parts = (
        itertools.repeat(None) if each is None else torch.split(each, at_once) for each in others
    )
    return zip(torch.split(seen, at_once), *parts, strict=False)


def _can_agree(world: World) -> bool:
    """Whether the AUVs of a world have something to agree on, and know what it takes."""
    sees_all = world.scenario.observation.view_range_m is None
    return world.num_auvs > 1 and world.duplex.num_choices > 1 and sees_all
