"""Learners of the time to quality: this trainer, and others on the same world.

Each takes a scenario and a seed, learns a little at a time, and tells its deterministic
policy. The others get what they like best: observations in [0, 1] with the time, rewards of
the order of one, the default preset's discount.
"""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from iout_marl.scenario import Scenario, load_scenario

sys.path.insert(0, str(Path(__file__).parent.parent / "examples"))

#: Environment steps of the schedules of this trainer's learning rate, by reward.
OUR_STEPS = {"paper": 409_600, "mean_age": 614_400}


class Learner(Protocol):
    """A learner."""

    scenario: Scenario

    def learn(self) -> int:
        """Learn a little more; environment steps so far."""
        ...

    def policy(self) -> Any:
        """What `iout_marl.evaluate` takes: the most probable actions."""
        ...


class Ours:
    """This trainer at its preset for short trainings, its schedule as long as it takes."""

    def __init__(self, scenario: Scenario, seed: int, device: str = "cpu") -> None:
        from trainers import Trainer

        steps = OUR_STEPS[scenario.reward.kind]
        # By its name: a scenario that is loaded says itself what a preset would.
        changes = {"training.preset": "short", "training.steps": steps}
        self.scenario = load_scenario(scenario.name, changes)
        self._trainer = Trainer(self.scenario, seed, device)

    def learn(self) -> int:
        self._trainer.iterate()
        return self._trainer.env_steps

    def policy(self) -> Any:
        from trainers import TrainedPolicy

        if self._trainer.runtime.device.type == "cpu":
            return TrainedPolicy(self._trainer.network)
        return self._trainer.policy()


def at_papers_settings(scenario: Scenario, seed: int) -> Any:
    """Stable-Baselines3's PPO on the joint environment, at the paper's settings."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import DummyVecEnv

    from iout_marl.envs import AUVEnv

    settings = load_scenario(scenario, {"training.preset": "paper"}).training
    samples = settings.environments * settings.rollout_slots
    return PPO(
        "MlpPolicy",
        DummyVecEnv([lambda: AUVEnv(scenario)] * settings.environments),
        learning_rate=settings.learning_rate,
        n_steps=settings.rollout_slots,
        batch_size=samples // settings.minibatches,
        n_epochs=settings.epochs,
        gamma=settings.discount,
        gae_lambda=settings.gae_lambda,
        clip_range=settings.clip,
        ent_coef=settings.entropy_coefficient,
        device="cpu",
        seed=seed,
    )


class StableBaselines3:
    """Stable-Baselines3 on the joint environment, at the paper's settings."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        self.scenario = scenario
        self._model = at_papers_settings(scenario, seed)

    def learn(self) -> int:
        self._model.learn(8_000, reset_num_timesteps=False)
        return int(self._model.num_timesteps)

    def policy(self) -> Callable[[Any], Any]:
        def act(observations: Any) -> Any:
            envs, auvs, entries = observations.shape
            rows = observations.reshape(envs * auvs, entries)
            actions, _ = self._model.predict(rows, deterministic=True)
            return actions.reshape(envs, auvs, -1)

        return act


class StableBaselines3Sixteen(StableBaselines3):
    """Stable-Baselines3 with 16 environments, rewards and observations scaled."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        from train_sb3 import make_model

        self.scenario = as_liked(scenario)
        self._model = make_model(self.scenario, seed, num_envs=16)


class TorchRL:
    """The parts of TorchRL."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        from train_torchrl import MAPPO

        self.scenario = as_liked(scenario)
        self._mappo = MAPPO(self.scenario, seed)
        self._steps = 0

    def learn(self) -> int:
        self._mappo.learn(8_000)
        self._steps += 8_000
        return self._steps

    def policy(self) -> Callable[[Any], Any]:
        import torch
        from tensordict import TensorDict
        from train_torchrl import OBSERVATION

        def act(observations: Any) -> Any:
            batch = TensorDict({OBSERVATION: torch.as_tensor(observations)}, observations.shape[:1])
            with torch.no_grad():
                return self._mappo.actor.get_dist(batch).mode.numpy()

        return act


class SingleFile:
    """PPO as CleanRL (Huang et al., 2022) writes it: one loop, one agent class, SyncVectorEnv.

    Its defaults: 128 steps, 4 minibatches, 4 epochs, learning rate 2.5e-4, falling; with 16
    environments.
    """

    ENVS, SLOTS, EPOCHS, MINIBATCHES = 16, 128, 4, 4
    RATE, CLIP, GAE_LAMBDA, ENTROPY = 2.5e-4, 0.2, 0.95, 0.01
    STEPS = 2_000_000

    def __init__(self, scenario: Scenario, seed: int) -> None:
        import gymnasium
        import torch
        from torch import nn

        from iout_marl.envs import AUVEnv

        torch.manual_seed(seed)
        self.scenario = as_liked(scenario)
        self._discount = scenario.training.discount
        env = gymnasium.vector.SyncVectorEnv([lambda: AUVEnv(self.scenario)] * self.ENVS)
        self._env = gymnasium.wrappers.vector.NormalizeReward(env, gamma=self._discount)
        self._sizes = self._env.single_action_space.nvec.tolist()
        (entries,) = self._env.single_observation_space.shape

        def network(outputs: int, gain: float) -> nn.Sequential:
            sizes, layers = [entries, 64, 64, outputs], []
            for i, (a, b) in enumerate(itertools.pairwise(sizes)):
                linear = nn.Linear(a, b)
                nn.init.orthogonal_(linear.weight, gain if i == 2 else math.sqrt(2))
                nn.init.zeros_(linear.bias)
                layers += [linear, nn.Tanh()]
            return nn.Sequential(*layers[:-1])

        self._actor, self._critic = network(sum(self._sizes), 0.01), network(1, 1.0)
        self._parameters = [*self._actor.parameters(), *self._critic.parameters()]
        self._optimizer = torch.optim.Adam(self._parameters, lr=self.RATE, eps=1e-5)
        observation, _ = self._env.reset(seed=seed)
        self._observation = torch.as_tensor(observation)
        self._steps = 0

    def _policy_of(self, observation: Any) -> list[Any]:
        from torch.distributions import Categorical

        parts = self._actor(observation).split(self._sizes, dim=-1)
        return [Categorical(logits=part) for part in parts]

    def learn(self) -> int:
        import torch

        shape = (self.SLOTS, self.ENVS)
        seen = torch.zeros(*shape, *self._observation.shape[1:])
        actions = torch.zeros(*shape, len(self._sizes), dtype=torch.int64)
        log_p, rewards, values, ends = (torch.zeros(shape) for _ in range(4))
        for t in range(self.SLOTS):
            with torch.no_grad():
                policy = self._policy_of(self._observation)
                action = torch.stack([p.sample() for p in policy], -1)
                log_p[t] = sum(p.log_prob(a) for p, a in zip(policy, action.T, strict=True))
                values[t] = self._critic(self._observation)[:, 0]
            seen[t], actions[t] = self._observation, action
            observation, reward, _, truncated, _ = self._env.step(action.numpy())
            self._observation = torch.as_tensor(observation)
            rewards[t], ends[t] = torch.as_tensor(reward), torch.as_tensor(truncated).float()
        with torch.no_grad():
            next_value = self._critic(self._observation)[:, 0]
        advantages, last = torch.zeros(shape), torch.zeros(self.ENVS)
        for t in reversed(range(self.SLOTS)):
            alive = 1 - ends[t]
            delta = rewards[t] + self._discount * next_value * alive - values[t]
            last = advantages[t] = delta + self._discount * self.GAE_LAMBDA * alive * last
            next_value = values[t]
        flat = [x.flatten(0, 1) for x in (seen, actions, log_p, advantages, advantages + values)]
        self._optimizer.param_groups[0]["lr"] = self.RATE * max(1 - self._steps / self.STEPS, 0.0)
        for _ in range(self.EPOCHS):
            for rows in torch.randperm(self.SLOTS * self.ENVS).chunk(self.MINIBATCHES):
                self._update(*(x[rows] for x in flat))
        self._steps += self.SLOTS * self.ENVS
        return self._steps

    def _update(self, seen: Any, action: Any, before: Any, advantage: Any, target: Any) -> None:
        import torch

        policy = self._policy_of(seen)
        now = sum(p.log_prob(a) for p, a in zip(policy, action.T, strict=True))
        ratio = (now - before).exp()
        advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
        clipped = ratio.clamp(1 - self.CLIP, 1 + self.CLIP)
        surrogate = torch.minimum(ratio * advantage, clipped * advantage).mean()
        value_loss = (self._critic(seen)[:, 0] - target).square().mean()
        entropy = sum(p.entropy() for p in policy).mean()
        self._optimizer.zero_grad()
        (0.25 * value_loss - surrogate - self.ENTROPY * entropy).backward()
        torch.nn.utils.clip_grad_norm_(self._parameters, 0.5)
        self._optimizer.step()

    def policy(self) -> Callable[[Any], Any]:
        import torch

        def act(observations: Any) -> Any:
            with torch.no_grad():
                policy = self._policy_of(torch.as_tensor(observations))
            return np.stack([p.probs.argmax(-1).numpy() for p in policy], axis=-1)

        return act


def as_liked(scenario: Scenario) -> Scenario:
    """The scenario with observations as other trainers like them; the world is the same."""
    return load_scenario(scenario, {"observation.kind": "scaled", "observation.time": True})


LEARNERS: dict[str, Callable[..., Learner]] = {
    "this trainer": Ours,
    "Stable-Baselines3, paper's settings": StableBaselines3,
    "Stable-Baselines3, 16 environments": StableBaselines3Sixteen,
    "CleanRL-style PPO": SingleFile,
    "TorchRL": TorchRL,
}
