"""The joint environment and the batched one under Gymnasium's checker, makers and wrappers."""

import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from env_cases import CASES, SLOTS, STARTS, case_scenario, scenario
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import RecordEpisodeStatistics

from iout_marl.envs import AUVEnv, AUVParallelEnv, AUVVectorEnv

ENV_ID = "iout_marl:AUV-v0"


def make_vec(world, mode="vector_entry_point", num_envs=3):
    return gymnasium.make_vec(ENV_ID, num_envs=num_envs, vectorization_mode=mode, scenario=world)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_joint_environment_passes_gymnasiums_checker(case):
    # It draws in every render mode: text is enough for most, `test_render` draws pixels.
    world = case_scenario(case)
    check_env(gymnasium.make(ENV_ID, scenario=world).unwrapped, skip_render_check=True)


def test_joint_environment_passes_gymnasiums_checker_in_every_render_mode():
    check_env(gymnasium.make(ENV_ID, scenario=scenario("tdd", 3)).unwrapped)


@pytest.mark.slow
def test_the_id_imports_the_package_by_itself():
    code = f"import gymnasium; print(gymnasium.make({ENV_ID!r}, scenario='paper/k3-tdd').unwrapped)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "AUVEnv" in done.stdout


@pytest.mark.parametrize("duplex", ["fdd", "tdd"])
@pytest.mark.parametrize("auvs", STARTS)
def test_joint_spaces_are_those_of_the_auvs_end_to_end(duplex, auvs):
    world = scenario(duplex, auvs)
    joint, parallel = AUVEnv(world), AUVParallelEnv(world)
    action, observation = (
        space("auv_0") for space in (parallel.action_space, parallel.observation_space)
    )
    assert joint.action_space.nvec.tolist() == action.nvec.tolist() * auvs
    np.testing.assert_array_equal(joint.observation_space.low, np.tile(observation.low, auvs))
    np.testing.assert_array_equal(joint.observation_space.high, np.tile(observation.high, auvs))


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_joint_environment_is_the_parallel_one_taken_together(case):
    world = case_scenario(case)
    joint, parallel = AUVEnv(world), AUVParallelEnv(world)
    masked = world.observation.action_mask == "observation"

    def agree(observation, info, observations, infos):
        agents = list(observations)
        named = [observations[a] for a in agents]
        if not isinstance(observation, dict):
            observation, named = {"": observation}, [{"": each} for each in named]
        assert masked == ("action_mask" in observation)
        for name, array in observation.items():
            np.testing.assert_array_equal(array, np.concatenate([each[name] for each in named]))
        assert set(info) == set(infos["auv_0"])
        for name, value in info.items():
            parts = [infos[a][name] for a in agents]
            if name == "action_mask":
                np.testing.assert_array_equal(value, np.concatenate(parts))
            elif name in ("harvested_j", "delivered"):
                assert value == sum(parts)
            else:
                assert value == pytest.approx(np.mean(parts), rel=1e-12)

    for seed in (4, None):
        agree(*joint.reset(seed=seed), *parallel.reset(seed=seed))
        truncated = False
        while not truncated:
            action = joint.action_space.sample()
            observation, reward, terminated, truncated, info = joint.step(action)
            parts = np.split(action, len(parallel.agents))
            observations, rewards, _, truncations, infos = parallel.step(
                dict(zip(parallel.agents, parts, strict=True))
            )
            agree(observation, info, observations, infos)
            assert reward == pytest.approx(np.mean(list(rewards.values())), rel=1e-12)
            assert type(reward) is float
            assert (terminated, truncated) == (False, truncations["auv_0"])


@pytest.mark.parametrize("mode", ["vector_entry_point", "sync"])
@pytest.mark.parametrize("mask", ["none", "observation"])
def test_make_vec_makes_environments_that_play(mode, mask):
    envs = make_vec(scenario(mask=mask), mode)
    observations, _ = envs.reset(seed=1)
    assert observations in envs.observation_space
    for _ in range(SLOTS + 2):
        observations, rewards, *_ = envs.step(envs.action_space.sample())
        assert observations in envs.observation_space
        assert rewards.shape == (3,)
    envs.close()


def test_make_vec_takes_the_batched_environment_by_default():
    envs = gymnasium.make_vec(ENV_ID, num_envs=2, scenario=scenario())
    assert isinstance(envs.unwrapped, AUVVectorEnv)


def test_batched_environment_declares_how_it_resets():
    assert AUVVectorEnv.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert make_vec(scenario()).metadata["autoreset_mode"] is AutoresetMode.SAME_STEP


def test_wrappers_of_batched_environments_count_whole_episodes():
    envs = RecordEpisodeStatistics(make_vec(scenario("tdd", 3)))
    envs.reset(seed=0)
    total = np.zeros(3)
    for _ in range(SLOTS):
        *_, infos = (step := envs.step(envs.action_space.sample()))
        total += step[1]
    np.testing.assert_allclose(infos["episode"]["r"], total)
    assert infos["episode"]["l"].tolist() == [SLOTS] * 3
