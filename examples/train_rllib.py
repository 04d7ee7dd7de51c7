"""RLlib's PPO: one RLModule that all AUVs share.

    pip install 'ray[rllib]' torch
    python examples/train_rllib.py [--scenario best/k10-fdd] [--auvs 3] [--steps 30_000]

RLlib takes the ParallelEnv by its `ParallelPettingZooEnv`, and MultiDiscrete actions as they
are. The environment is stepped in this process: `num_env_runners` adds others.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import supersuit
import torch
from common import mean_aoi, parse, tell
from ray.rllib.algorithms.ppo import PPO, PPOConfig
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from ray.rllib.core.rl_module.rl_module import RLModuleSpec
from ray.rllib.env.wrappers.pettingzoo_env import ParallelPettingZooEnv
from ray.tune.registry import register_env

from iout_marl import Scenario, iout_v0

#: Slots of an iteration: the AUVs bring as many samples each.
SLOTS = 400


def make_algorithm(scenario: Scenario, seed: int = 0) -> PPO:
    """PPO on one environment; every AUV plays the policy "shared"."""

    def make_env(_: Any) -> ParallelPettingZooEnv:
        # Returns of the order of one, as critics like them.
        env = supersuit.reward_lambda_v0(iout_v0.parallel_env(scenario), lambda r: r / 100)
        return ParallelPettingZooEnv(env)

    register_env("iout", make_env)
    model = DefaultModelConfig(fcnet_hiddens=[64, 64], vf_share_layers=False)
    config = (
        PPOConfig()
        .environment("iout")
        .env_runners(num_env_runners=0, batch_mode="complete_episodes")
        .multi_agent(policies={"shared"}, policy_mapping_fn=lambda *_, **__: "shared")
        .rl_module(rl_module_spec=RLModuleSpec(model_config=model))
        .training(
            train_batch_size_per_learner=SLOTS,
            minibatch_size=SLOTS * scenario.num_auvs // 4,
            num_epochs=4,
            lr=2e-3,
            gamma=0.97,
            lambda_=0.95,
            clip_param=0.2,
            entropy_coeff=0.003,
            use_kl_loss=False,
            grad_clip=0.5,
        )
        .debugging(seed=seed, log_level="ERROR")
    )
    return config.build_algo()


def policy_of(algorithm: PPO) -> Callable[[Any], Any]:
    """What `iout_marl.evaluate` takes: (envs, auvs, entries) observations to actions."""
    module = algorithm.get_module("shared")

    def policy(observations: Any) -> Any:
        envs, auvs, entries = observations.shape
        rows = torch.as_tensor(observations.reshape(envs * auvs, entries))
        with torch.no_grad():
            logits = module.forward_inference({"obs": rows})["action_dist_inputs"]
        distribution = module.get_inference_action_dist_cls().from_logits(logits)
        return distribution.sample().numpy().reshape(envs, auvs, -1)  # drawn, as in training

    return policy


def main(arguments: list[str] | None = None) -> tuple[float, float]:
    """Trains, prints and returns the mean AoI before and after."""
    options, scenario = parse(__doc__, arguments)
    algorithm = make_algorithm(scenario, options.seed)
    before = mean_aoi(scenario, policy_of(algorithm))
    for _ in range(0, options.steps, SLOTS * options.auvs):
        algorithm.train()
    after = mean_aoi(scenario, policy_of(algorithm))
    algorithm.stop()
    return tell("RLlib PPO", before, after, options.steps)


if __name__ == "__main__":
    main()
