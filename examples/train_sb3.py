"""Stable-Baselines3's PPO on the batched world: one policy that all AUVs share.

    pip install stable-baselines3
    python examples/train_sb3.py [--scenario best/k10-fdd] [--auvs 3] [--steps 30_000]

Every AUV of every world is a slot of one VecEnv, so that a single-agent algorithm learns from all
of them: parameter sharing, independent PPO. sb3-contrib's MaskablePPO takes the same VecEnv.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from common import mean_aoi, parse, tell
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecNormalize

from iout_marl import Scenario
from iout_marl.envs import sb3_vec_env


def make_model(scenario: Scenario, seed: int = 0, num_envs: int = 4) -> PPO:
    """PPO on `num_envs` worlds; every rollout is an episode of each."""
    vec_env = sb3_vec_env(scenario, num_envs)
    return PPO(
        "MlpPolicy",
        # Returns of the order of one, as critics like them; observations are scaled already.
        VecNormalize(vec_env, norm_obs=False, norm_reward=True, gamma=0.97),
        n_steps=scenario.num_slots,
        batch_size=vec_env.num_envs * scenario.num_slots // 4,
        n_epochs=4,
        learning_rate=2e-3,
        gamma=0.97,
        ent_coef=0.003,
        seed=seed,
        device="cpu",
    )


def policy_of(model: PPO) -> Callable[[Any], Any]:
    """What `iout_marl.evaluate` takes: (envs, auvs, entries) observations to actions."""

    def policy(observations: Any) -> Any:
        envs, auvs, entries = observations.shape
        rows = observations.reshape(envs * auvs, entries)
        actions, _ = model.predict(rows, deterministic=False)  # drawn, as in training
        return actions.reshape(envs, auvs, -1)

    return policy


def main(arguments: list[str] | None = None) -> tuple[float, float]:
    """Trains, prints and returns the mean AoI before and after."""
    options, scenario = parse(__doc__, arguments)
    model = make_model(scenario, options.seed)
    before = mean_aoi(scenario, policy_of(model))
    model.learn(options.steps)
    after = mean_aoi(scenario, policy_of(model))
    return tell("SB3 PPO", before, after, options.steps)


if __name__ == "__main__":
    main()
