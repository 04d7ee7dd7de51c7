"""Stable-Baselines3's wrappers and PPO on the batched VecEnv."""

import csv

import numpy as np
import pytest
from env_cases import SLOTS, STARTS, scenario
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import EvalCallback
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.logger import configure
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecFrameStack, VecMonitor, VecNormalize
from vec_env_cases import actions_for

from iout_marl.envs import AUVEnv, sb3_vec_env

each_fleet = pytest.mark.parametrize("auvs", STARTS)
each_mask = pytest.mark.parametrize("mask", ["none", "info", "observation"])


def test_vec_monitor_counts_what_the_infos_tell():
    world = scenario(auvs=3)
    bare = sb3_vec_env(world, 2)
    with pytest.warns(UserWarning, match="already wrapped with a `Monitor`"):
        monitored = VecMonitor(sb3_vec_env(world, 2))
    bare.reset(0)
    monitored.seed(0)
    monitored.reset()
    for actions in actions_for(bare, SLOTS):
        own, theirs = bare.step(actions)[3], monitored.step(actions)[3]
    for a, b in zip(own, theirs, strict=True):
        assert a["episode"]["r"] == pytest.approx(b["episode"]["r"], rel=1e-5)
        assert a["episode"]["l"] == b["episode"]["l"] == SLOTS
        assert 0 <= a["episode"]["t"] < 1e6


def test_vec_normalize_scales_last_observations_too():
    vec_env = VecNormalize(sb3_vec_env(scenario(), 2), gamma=0.9)
    vec_env.seed(0)
    assert np.isfinite(vec_env.reset()).all()
    for actions in actions_for(vec_env, SLOTS):
        observations, _, dones, infos = vec_env.step(actions)
    assert dones.all()
    assert np.abs(observations).max() <= 10
    for info in infos:
        assert np.abs(info["terminal_observation"]).max() <= 10


def test_vec_frame_stack_begins_anew_with_the_episode():
    vec_env = VecFrameStack(sb3_vec_env(scenario(), 2), n_stack=2)
    entries = vec_env.venv.observation_space.shape[0]
    vec_env.reset()
    for actions in actions_for(vec_env, SLOTS):
        observations, _, dones, infos = vec_env.step(actions)
    assert dones.all()
    assert not observations[:, :entries].any()
    assert infos[0]["terminal_observation"].shape == (2 * entries,)
    assert infos[0]["terminal_observation"][:entries].any()


@pytest.mark.slow
def test_statistics_reach_evaluation_and_its_callback(tmp_path):
    world = scenario(auvs=3)
    vec_env = sb3_vec_env(world, 2)
    model = PPO("MlpPolicy", vec_env, n_steps=SLOTS, batch_size=SLOTS, n_epochs=1, seed=0)
    model.set_logger(configure(str(tmp_path), ["csv"]))
    callback = EvalCallback(sb3_vec_env(world, 1), eval_freq=SLOTS, n_eval_episodes=3, verbose=0)
    model.learn(SLOTS * vec_env.num_envs, callback)
    model.logger.close()
    assert np.isfinite(callback.last_mean_reward)
    with (tmp_path / "progress.csv").open() as file:
        # A line of the callback's own has nothing there.
        (logged,) = (line for line in csv.DictReader(file) if line["rollout/ep_len_mean"])
    assert float(logged["rollout/ep_len_mean"]) == SLOTS
    returns = [info["r"] for info in model.ep_info_buffer]
    assert len(returns) == vec_env.num_envs
    assert float(logged["rollout/ep_rew_mean"]) == pytest.approx(np.mean(returns), rel=1e-4)
    # Warnings are errors here: `evaluate_policy` would warn if there were no statistics.
    rewards, lengths = evaluate_policy(model, VecNormalize(vec_env), 6, return_episode_rewards=True)
    assert lengths == [SLOTS] * 6
    assert max(rewards) < 0  # as they are, not as they were normalised


def test_ppo_values_what_follows_the_time_limit():
    """The last rewards of an episode have the value of its last observation added to them."""
    vec_env = sb3_vec_env(scenario(), 2)
    model = PPO("MlpPolicy", vec_env, n_steps=SLOTS, batch_size=SLOTS, n_epochs=1, seed=0)
    rewards = []

    def keep(told, _):
        rewards.append(told["rewards"].copy())
        return True

    model.learn(SLOTS * 2, keep)
    np.testing.assert_array_equal(model.rollout_buffer.rewards[:-1], rewards[:-1])
    assert (model.rollout_buffer.rewards[-1] != rewards[-1]).all()


@each_mask
@each_fleet
def test_ppo_learns_beside_masks(auvs, mask):
    world = scenario(auvs=auvs, layout="episode", mask=mask)
    policy = "MultiInputPolicy" if mask == "observation" else "MlpPolicy"
    model = PPO(policy, sb3_vec_env(world, 2), n_steps=8, batch_size=16, n_epochs=1, seed=0)
    before = [parameter.clone() for parameter in model.policy.parameters()]
    model.learn(16 * 2 * auvs)
    assert any((a != b).any() for a, b in zip(before, model.policy.parameters(), strict=True))
    assert model.env.reset_infos[0]["time_mean_aoi"] > 0


def test_ppo_trains_as_on_single_environments():
    """The same seed gives the same rollouts and losses as SB3's own vectorised environment."""
    world = scenario(layout="fixed")
    settings = {"n_steps": SLOTS, "batch_size": SLOTS, "n_epochs": 2, "seed": 0}
    trained = [
        PPO("MlpPolicy", vec_env, **settings).learn(4 * SLOTS * 2)
        for vec_env in (
            sb3_vec_env(world, 2),
            DummyVecEnv([lambda: Monitor(AUVEnv(world)) for _ in range(2)]),
        )
    ]
    ours, theirs = ([*model.policy.parameters()] for model in trained)
    for a, b in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(a.detach(), b.detach(), rtol=1e-4, atol=1e-5)
    own, other = ([info["r"] for info in model.ep_info_buffer] for model in trained)
    np.testing.assert_allclose(own, other, rtol=1e-6)
