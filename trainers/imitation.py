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

from iout_marl.policies import Actions, BasePolicy, chosen_by, is_deterministic, take_actions
from iout_marl.policies.loading import named_policy
from iout_marl.policies.simulator import rows
from iout_marl.scenario import Scenario
from iout_marl.world import State, World
from iout_marl.world.actions import ActionCheck
from trainers.networks import IMPOSSIBLE
from trainers.ops import PolicyLoss

#: Tells the stream of teachers from those of layouts and actions, which have the same seed.
_STREAM = 0x7EAC


class Teacher:
    """Whose actions are learnt in a scenario.

    Every policy that is trained has a teacher to itself, which draws what it would draw alone.

    Args:
        scenario: the scenario.
        num_envs: environments of this process, of each policy that is trained.
        name: of the teacher, as for `--policy`.
        seeds: of these policies.

    Raises:
        InputError: there is no such policy, or it does not fit the scenario.
    """

    def __init__(self, scenario: Scenario, num_envs: int, name: str, seeds: Sequence[int]) -> None:
        self._seeds = seeds
        self._lessons = [_Lesson(scenario, num_envs, name, seed) for seed in seeds]
        self.begin(0, 0.0)

    @property
    def is_deterministic(self) -> bool:
        """Whether it leaves nothing to chance."""
        return all(is_deterministic(lesson.policy) for lesson in self._lessons)

    def begin(self, env_steps: int, progress: float) -> None:
        """A new rollout: a training that is resumed is shown the same.

        Args:
            env_steps: taken so far.
            progress: from 0 to 1, of the imitation: the share of slots that learners play
                themselves, unless the teacher only knows what follows its own actions.
        """
        self._rngs = [np.random.default_rng([seed, _STREAM, env_steps]) for seed in self._seeds]
        self._own_share = 0.0 if self._lessons[0].policy.plans_ahead else progress
        for lesson in self._lessons:
            lesson.begin()

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
        by_policy = (rows(exact, envs) for envs in np.split(np.arange(len(state.slot)), len(own)))
        chosen = [
            lesson.act(each, rng)
            for lesson, each, rng in zip(self._lessons, by_policy, self._rngs, strict=True)
        ]
        action = torch.from_numpy(np.stack(chosen))
        drawn = [torch.from_numpy(rng.random(num_envs)[place]) for rng in self._rngs]
        plays_itself = torch.stack(drawn) < self._own_share
        return action, torch.where(plays_itself[..., None, None], own, action)


class _Lesson:
    """A teacher in the environments of one policy that is trained."""

    def __init__(self, scenario: Scenario, num_envs: int, name: str, seed: int) -> None:
        self._scenario, self._name, self._seed = scenario, name, seed
        # In float64, as policies are used to.
        self._world = world = World(scenario, num_envs)
        self._check = ActionCheck(world.num_envs, world.num_auvs, world.action_sizes)
        self.policy = self._made()
        self._foreseen: State | None = None

    def _made(self) -> BasePolicy:
        option = "training.imitate"
        return named_policy(self._scenario, self._name, self._seed, option, transfer=True)[1]

    def begin(self) -> None:
        """A new rollout."""
        self._foreseen = None
        if self.policy.plans_ahead and self._world.chance:
            # A plan is kept as long as time goes by it: one for each rollout.
            self.policy = self._made()

    def act(self, state: State, rng: np.random.Generator) -> Actions:
        """(envs, auvs, entries) actions in a state, in float64."""
        # Plans foresee states in float64: those of the training are no longer these after a slot.
        keeps_to_plan = self.policy.plans_ahead and not self._world.chance
        if keeps_to_plan and self._foreseen is not None and state.slot[0] > 0:
            state = self._foreseen
        asked = chosen_by(self.policy, self._world, state, rng)
        chosen = take_actions(self.policy, asked, self._check)
        if keeps_to_plan:
            self._foreseen, _ = self._world.step(state, chosen)
        return chosen


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
