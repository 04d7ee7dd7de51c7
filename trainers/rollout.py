"""Runs the policy in the batched world and keeps what it saw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from torch import Tensor

from iout_marl.scenario import Scenario
from iout_marl.world import State, World, node_codes, redraws_every_episode
from trainers.networks import ActorCritic, gumbel_noise


@dataclass
class Rollout:
    """A rollout, (slots, envs, auvs, …) each; `truncated` is (slots,).

    All environments start and end their episodes together, so that one flag a slot
    tells of all of them.
    """

    observation: Tensor  # (slots, envs, auvs, entries) float32, as the world gives it
    privileged: Tensor | None  # (slots, envs, auvs, entries) float32, for the critic alone
    inputs: Tensor  # (slots, envs, auvs, entries) float32, scaled as the policy saw it
    critic_inputs: Tensor  # (slots, envs, auvs, entries) float32, scaled as the critic saw it
    mask: Tensor | None  # (slots, envs, auvs, choices) bool, where masks are in use
    action: Tensor  # (slots, envs, auvs, entries) int64
    log_probability: Tensor  # (slots, envs, auvs) float32
    value: Tensor  # (slots, envs, auvs) float32
    reward: Tensor  # (slots, envs, auvs) float32, as the world gives it
    truncated: list[bool]  # (slots,): the episode ended with this slot
    next_value: Tensor  # (slots, envs, auvs): value of what followed the slot
    episodes: list[dict[str, float]] = field(default_factory=list)  # metrics of whole episodes
    reward_terms: dict[str, float] = field(default_factory=dict)  # mean of each term a slot


class Simulation:
    """The batched world, its state, and the streams that it draws from.

    On a CPU the world runs on NumPy, which shares its memory with torch and handles
    small arrays in less time; on an accelerator it runs on torch, where the networks are.

    Args:
        scenario: the scenario.
        num_envs: environments side by side.
        device: where the networks are.
        seed: seeds layouts and actions.
    """

    def __init__(self, scenario: Scenario, num_envs: int, device: torch.device, seed: int) -> None:
        on_cpu = device.type == "cpu"
        self.device = device
        self.world = World(
            scenario,
            num_envs,
            library=np if on_cpu else torch,
            dtype="float32",
            device=None if on_cpu else device,
        )
        self.layout_rng = np.random.default_rng(seed)
        self.generator = torch.Generator(device)
        self.generator.manual_seed(seed)
        self._is_central = scenario.training.critic == "central"
        self._redraws = redraws_every_episode(scenario)
        self.state = self._first_state()

    def _first_state(self, previous: State | None = None) -> State:
        if previous is not None and not self._redraws:
            return self.world.reset(previous.node_cell)
        rngs: Sequence[np.random.Generator] = [self.layout_rng] * self.world.num_envs
        return self.world.reset(node_codes(self.world.scenario, self.world.grid, rngs))

    def _tensor(self, array: Any, dtype: torch.dtype | None = None) -> Tensor:
        return torch.as_tensor(array, dtype=dtype, device=self.device)

    def observe(self) -> Tensor:
        """(envs, auvs, entries) float32."""
        return self._tensor(self.world.observe(self.state), torch.float32)

    def observe_for_critic(self) -> Tensor | None:
        """(envs, auvs, entries) float32 that the critic alone sees."""
        seen = self.world.observer.observe_for_critic(self.state, central=self._is_central)
        return None if seen is None else self._tensor(seen, torch.float32)

    def value(self, network: ActorCritic) -> Tensor:
        """Value of the present state to every AUV, (envs, auvs)."""
        inputs = network.scaler(self.observe())
        return network.value(network.critic_inputs(inputs, self.observe_for_critic()))

    @torch.no_grad()
    def collect(self, network: ActorCritic, slots: int, *, use_mask: bool) -> Rollout:
        """Run the policy for `slots` slots of every environment."""
        world = self.world
        shape = (slots, world.num_envs, world.num_auvs)

        def empty(*entries: int, dtype: torch.dtype = torch.float32) -> Tensor:
            return torch.empty(*shape, *entries, dtype=dtype, device=self.device)

        choices, entries = sum(world.action_sizes), len(world.action_sizes)
        observed = self.observe().shape[-1]
        inputs = empty(observed)
        seen = self.observe_for_critic()
        rollout = Rollout(
            observation=empty(observed),
            privileged=None if seen is None else empty(seen.shape[-1]),
            inputs=inputs,
            critic_inputs=inputs,
            mask=empty(choices, dtype=torch.bool) if use_mask else None,
            action=empty(entries, dtype=torch.int64),
            log_probability=empty(0),
            value=empty(0),
            reward=empty(),
            truncated=[],
            next_value=empty(),
        )
        scores = empty(entries, network.width)
        # Drawn at once, like all that need not wait for the next slot.
        noise = gumbel_noise(scores.shape, self.generator)
        terms_total: dict[str, Any] = {}
        for t in range(slots):
            observation = self.observe()
            inputs[t] = network.scaler(observation)
            mask = self._tensor(world.action_mask(self.state)) if use_mask else None
            scores[t] = network.scores(inputs[t], mask)
            action = network.choose(scores[t], noise[t])
            rollout.observation[t] = observation
            seen = self.observe_for_critic()
            if rollout.privileged is not None and seen is not None:
                rollout.privileged[t] = seen
            if rollout.mask is not None and mask is not None:
                rollout.mask[t] = mask
            rollout.action[t] = action

            world_action = action.numpy() if world.backend.xp is np else action
            self.state, events = world.step(self.state, world_action)
            terms = world.reward_terms(self.state, events)
            rollout.reward[t] = self._tensor(sum(terms.values()))
            for name, term in terms.items():
                terms_total[name] = terms_total.get(name, 0.0) + term.mean()

            ended = int(self.state.slot[0]) >= world.num_slots
            rollout.truncated.append(ended)
            if ended:
                # A time limit is no end of the task: what lies beyond it still counts.
                rollout.next_value[t] = self.value(network)
                metrics = world.metrics(self.state)
                rollout.episodes.append({k: float(v.mean()) for k, v in metrics.items()})
                self.state = self._first_state(self.state)
        rollout.log_probability = network.log_probability(
            network.normalised(scores), rollout.action
        )
        rollout.critic_inputs = network.critic_inputs(inputs, rollout.privileged)
        rollout.value = network.value(rollout.critic_inputs)
        for t, ended in enumerate(rollout.truncated[:-1]):
            if not ended:
                rollout.next_value[t] = rollout.value[t + 1]
        if not rollout.truncated[-1]:
            rollout.next_value[-1] = self.value(network)
        rollout.reward_terms = {k: float(v) / slots for k, v in terms_total.items()}
        return rollout

    def state_dict(self) -> dict[str, Any]:
        """State and streams, as tensors and plain values."""
        arrays = self.state._asdict()
        return {
            "state": {k: torch.as_tensor(v).cpu().clone() for k, v in arrays.items()},
            "layout_rng": self.layout_rng.bit_generator.state,
            "generator": self.generator.get_state(),
        }

    def load_state_dict(self, saved: dict[str, Any]) -> None:
        """Go on from a `state_dict`."""
        if self.world.backend.xp is np:
            arrays = {k: v.numpy().copy() for k, v in saved["state"].items()}
        else:
            arrays = {k: v.to(self.device) for k, v in saved["state"].items()}
        self.state = State(**arrays)
        self.layout_rng.bit_generator.state = saved["layout_rng"]
        self.generator.set_state(saved["generator"])
