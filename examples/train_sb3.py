"""Stable-Baselines3's PPO, through SuperSuit: one policy that all AUVs share.

    pip install stable-baselines3
    python examples/train_sb3.py [--scenario best/k10-fdd] [--auvs 3] [--steps 30_000]

SuperSuit makes every AUV of every copy of the environment a slot of one VecEnv, so that a
single-agent algorithm learns from all of them: parameter sharing, independent PPO.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecNormalize

from iout_marl import Scenario, evaluate, load_scenario
from iout_marl.envs import sb3_vec_env

#: Uplinks share one band; observations in [0, 1], with the time, as networks like them.
SETTINGS = {
    "channel.access": "interference",
    "observation.kind": "scaled",
    "observation.time": True,
}


def make_model(scenario: Scenario, seed: int = 0, num_envs: int = 4) -> PPO:
    """PPO on `num_envs` copies of the environment; every rollout is an episode of each."""
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


def mean_aoi(scenario: Scenario, policy: Callable[[Any], Any]) -> float:
    """Mean Age of Information over 100 episodes, in slots."""
    return evaluate(scenario, policy, episodes=100).metrics["mean_aoi"].mean


def main(arguments: list[str] | None = None) -> tuple[float, float]:
    """Trains, prints and returns the mean AoI before and after."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", default="best/k10-fdd")
    parser.add_argument("--auvs", type=int, default=3)
    parser.add_argument("--steps", type=int, default=30_000, help="actions of all AUVs together")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    scenario = load_scenario(options.scenario, {"auvs.count": options.auvs, **SETTINGS})
    model = make_model(scenario, options.seed)
    before = mean_aoi(scenario, policy_of(model))
    model.learn(options.steps)
    after = mean_aoi(scenario, policy_of(model))
    print(f"SB3 PPO: mean AoI {before:.2f} before, {after:.2f} after {options.steps} steps")
    return before, after


if __name__ == "__main__":
    main()
