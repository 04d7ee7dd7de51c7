"""Tianshou's PPO on the joint environment: one controller for the whole fleet.

    pip install tianshou
    python examples/train_tianshou.py [--scenario best/k10-fdd] [--auvs 3] [--steps 30_000]

Tianshou's way to several agents is PettingZoo's AEC form, where the rewards come when the last
agent has acted: it would credit all agents but the last with nothing. So it gets the Gymnasium
API, in which the actions of all AUVs are one MultiDiscrete, drawn from torch's distributions.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import torch
from common import MultiCategorical, mean_aoi, parse, tell
from gymnasium.wrappers import TransformReward
from tianshou.algorithm import PPO
from tianshou.algorithm.modelfree.reinforce import ProbabilisticActorPolicy
from tianshou.algorithm.optim import AdamOptimizerFactory
from tianshou.data import Batch, Collector, VectorReplayBuffer
from tianshou.env import DummyVectorEnv
from tianshou.trainer import OnPolicyTrainerParams
from tianshou.utils.net.common import Net
from tianshou.utils.net.discrete import DiscreteCritic

from iout_marl import Scenario

ENVIRONMENTS = 4


def make_env(scenario: Scenario) -> gymnasium.Env[Any, Any]:
    """The joint environment, with returns of the order of one, as critics like them."""
    env = gymnasium.make("iout_marl:AUV-v0", scenario=scenario)
    return TransformReward(env, lambda reward: reward / 100)


def make_algorithm(scenario: Scenario, seed: int = 0) -> PPO:
    """PPO with an actor and a critic that see what all AUVs see."""
    np.random.seed(seed)  # noqa: NPY002 (Tianshou shuffles by the global generator)
    torch.manual_seed(seed)
    env = make_env(scenario)
    shape, sizes = env.observation_space.shape, env.action_space.nvec.tolist()
    actor = Net(state_shape=shape, action_shape=len(sizes) * max(sizes), hidden_sizes=(64, 64))
    policy = ProbabilisticActorPolicy(
        actor=actor,
        dist_fn=lambda logits: MultiCategorical(logits, sizes),
        action_space=env.action_space,
        action_scaling=False,
        action_bound_method=None,
    )
    critic = DiscreteCritic(preprocess_net=Net(state_shape=shape, hidden_sizes=(64, 64)))
    return PPO(
        policy=policy, critic=critic, optim=AdamOptimizerFactory(lr=2e-3), gamma=0.97,
        gae_lambda=0.95, ent_coef=0.003, max_grad_norm=0.5,
    )  # fmt: skip


def learn(algorithm: PPO, scenario: Scenario, steps: int, seed: int = 0) -> None:
    """Rollouts of whole episodes and updates from them, until `steps` actions were taken."""
    envs = DummyVectorEnv([lambda: make_env(scenario) for _ in range(ENVIRONMENTS)])
    envs.seed(seed)
    slots = ENVIRONMENTS * scenario.num_slots
    algorithm.run_training(
        OnPolicyTrainerParams(
            training_collector=Collector(algorithm, envs, VectorReplayBuffer(slots, ENVIRONMENTS)),
            max_epochs=1,
            epoch_num_steps=steps // scenario.num_auvs,
            collection_step_num_env_steps=slots,
            batch_size=slots // 4,
            update_step_num_repetitions=8,
            verbose=False,
        )
    )


def policy_of(algorithm: PPO) -> Callable[[Any], Any]:
    """What `iout_marl.evaluate` takes: (envs, auvs, entries) observations to actions."""

    def policy(observations: Any) -> Any:
        envs, auvs, _ = observations.shape
        with torch.no_grad():
            chosen = algorithm.policy(Batch(obs=observations.reshape(envs, -1), info={}))
        return chosen.act.numpy().reshape(envs, auvs, -1)

    return policy


def main(arguments: list[str] | None = None) -> tuple[float, float]:
    """Trains, prints and returns the mean AoI before and after."""
    options, scenario = parse(__doc__, arguments)
    algorithm = make_algorithm(scenario, options.seed)
    before = mean_aoi(scenario, policy_of(algorithm))
    learn(algorithm, scenario, options.steps, options.seed)
    after = mean_aoi(scenario, policy_of(algorithm))
    return tell("Tianshou PPO", before, after, options.steps)


if __name__ == "__main__":
    main()
