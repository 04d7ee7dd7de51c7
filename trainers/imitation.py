"""Learning what another policy does, before reinforcement learning goes on from there.

What is hard to come upon by chance, such as a dock an hour's way off, is easily shown: a teacher
plays whole episodes, the actor learns to choose as it does (behavioural cloning), and the critic
what comes of that. A learner that has only seen the teacher's episodes does not know what to do
beside them, so it plays more and more of the slots itself, and learns what the teacher would have
done in the states that it comes to (DAgger: Ross et al., 2011).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from iout_marl.policies import take_actions
from iout_marl.policies.loading import named_policy
from iout_marl.scenario import Scenario
from iout_marl.world import State, World
from iout_marl.world.actions import ActionCheck
from trainers.networks import IMPOSSIBLE
from trainers.ops import PolicyLoss

#: Tells the stream of teachers from those of layouts and actions, which have the same seed.
_STREAM = 0x7EAC


class Teacher:
    """Whose actions are learnt in a scenario.

    Args:
        scenario: the scenario.
        num_envs: environments of this process, of all policies that are trained side by side.
        name: of the teacher, as for `--policy`.
        seeds: of these policies.

    Raises:
        InputError: there is no such policy, or it does not fit the scenario.
    """

    def __init__(self, scenario: Scenario, num_envs: int, name: str, seeds: Sequence[int]) -> None:
        # In float64, as policies are used to.
        self._world = world = World(scenario, num_envs)
        _, self._policy = named_policy(scenario, name, seeds[0], "training.imitate", transfer=True)
        self._check = ActionCheck(world.num_envs, world.num_auvs, world.action_sizes)
        self._seeds = seeds
        self._foreseen: State | None = None
        self.begin(0, 0.0)

    def begin(self, env_steps: int, progress: float) -> None:
        """A new rollout, with streams of its own: a training that is resumed draws the same.

        Args:
            env_steps: taken so far.
            progress: from 0 to 1, of the imitation: the share of slots that learners play
                themselves, unless the teacher only knows what follows its own actions.
        """
        self._rngs = [np.random.default_rng([seed, _STREAM, env_steps]) for seed in self._seeds]
        self._own_share = 0.0 if self._policy.plans_ahead else progress

    def shows(
        self, state: State, own: Tensor, num_envs: int, place: slice
    ) -> tuple[Tensor, Tensor]:
        """What the teacher does in a state, and what is played.

        Args:
            state: of the environments of all policies, on NumPy.
            own: (policies, envs, auvs, entries) actions of the learners.
            num_envs: environments of each policy, of all processes.
            place: which of them are this process's.
        """
        exact = state.map(lambda a: a.astype(np.float64) if a.dtype.kind == "f" else a)
        # Plans foresee states in float64: those of the training are no longer these after a slot.
        keeps_to_plan = self._policy.plans_ahead and not self._world.chance
        if keeps_to_plan and self._foreseen is not None and state.slot[0] > 0:
            exact = self._foreseen
        chosen = self._policy.act(self._world, exact, self._rngs[0])
        chosen = take_actions(self._policy, chosen, self._check)
        if keeps_to_plan:
            self._foreseen, _ = self._world.step(exact, chosen)
        action = torch.from_numpy(chosen).view_as(own)
        drawn = [torch.from_numpy(rng.random(num_envs)[place]) for rng in self._rngs]
        plays_itself = torch.stack(drawn) < self._own_share
        return action, torch.where(plays_itself[..., None, None], own, action)


def imitation_loss(
    logits: Tensor, action: Tensor, entropy_coefficient: float, samples: int
) -> PolicyLoss:
    """The cross-entropy of what a teacher chose, with the entropy bonus of PPO.

    Choices that the learner's mask forbids are not learnt.

    Args:
        logits, action, entropy_coefficient, samples: as for `policy_loss`.
    """
    log_p = logits.log_softmax(-1)
    chosen = logits.gather(-1, action[..., None]) > IMPOSSIBLE / 2
    log_likelihood = log_p.gather(-1, action[..., None]).where(chosen, 0.0).sum((-3, -2, -1))
    entropy = -(log_p.exp() * log_p).sum((-3, -2, -1)) / samples
    loss = -log_likelihood / samples
    nothing = torch.zeros_like(loss)
    return PolicyLoss(loss - entropy_coefficient * entropy, loss, entropy, nothing, nothing)
