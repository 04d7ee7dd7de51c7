"""A trained network as a policy."""

from __future__ import annotations

import numpy as np
import torch

from iout_marl.errors import InputError
from iout_marl.policies import Actions
from iout_marl.world import State, World
from trainers.networks import ActorCritic


class TrainedPolicy:
    """Plays what a network has learnt.

    Args:
        network: actor and critic, on any device.
        name: what tables call it.
        use_mask: as in its training.
        sampled: draw actions from the policy, as in its training, rather than take the most
            probable ones.
    """

    def __init__(
        self,
        network: ActorCritic,
        name: str = "ppo",
        *,
        use_mask: bool = False,
        sampled: bool = False,
    ) -> None:
        self.network = network
        self.name = name
        self.use_mask = use_mask
        self.sampled = sampled

    @property
    def is_deterministic(self) -> bool:
        """Whether it leaves nothing to chance."""
        return not self.sampled

    @torch.no_grad()
    def act(self, world: World, state: State, rng: np.random.Generator) -> Actions:
        """See `iout_marl.policies.Policy`.

        Raises:
            InputError: the networks have come to numbers that are not finite.
        """
        device = self.network.scaler.shift.device
        observation = torch.as_tensor(world.observe(state), dtype=torch.float32, device=device)
        mask = None
        if self.use_mask:
            mask = torch.as_tensor(world.action_mask(state), device=device)
        scores = self.network.scores(self.network.scaler(observation), mask)
        if not scores.isfinite().all():
            raise InputError(
                f"{self.name}: its weights lead to numbers that are not finite: they are damaged, "
                "or of a training that diverged"
            )
        if not self.sampled:
            return self.network.choose(scores).cpu().numpy()
        noise = 1 - rng.random(scores.shape[:-1], dtype=np.float32)
        action, _ = self.network.sample(scores, torch.as_tensor(noise, device=device))
        return action.cpu().numpy()
