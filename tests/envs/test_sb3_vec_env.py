"""The VecEnv over the batched world plays what the other APIs play, as Stable-Baselines3 asks."""

import numpy as np
import pytest
from env_cases import CASES, SLOTS, STARTS, case_scenario, scenario
from stable_baselines3.common.env_checker import check_env
from vec_env_cases import actions_for, row

import iout_marl
from iout_marl import InputError, iout_v0
from iout_marl.envs import AUVEnv, AUVVectorEnv, sb3_vec_env, supersuit_vec_env
from iout_marl.testing import assert_equal

WORLDS = 3
SEED = 7
#: A single world is played number by number.
BATCHES = [(case, WORLDS) for case in CASES] + [(case, 1) for case in CASES if "episode" in case]

each_case = pytest.mark.parametrize("case", CASES)
each_fleet = pytest.mark.parametrize("auvs", STARTS)


@pytest.mark.slow
@each_case
# What it says of node tables, which it flattens.
@pytest.mark.filterwarnings("ignore:Your observation .* has an unconventional shape")
def test_joint_environment_passes_sb3s_checker(case):
    check_env(AUVEnv(case_scenario(case)))


@pytest.mark.slow
@pytest.mark.parametrize(("case", "worlds"), BATCHES)
def test_slot_by_slot_it_plays_what_the_parallel_environments_play(case, worlds):
    world = case_scenario(case)
    vec_env = sb3_vec_env(world, worlds)
    singles = [iout_v0.parallel_env(world) for _ in range(worlds)]
    names = singles[0].possible_agents
    places = [(env, name) for env in range(worlds) for name in names]
    assert vec_env.num_envs == len(places)
    assert vec_env.observation_space == singles[0].observation_space("auv_0")
    assert vec_env.action_space == singles[0].action_space("auv_0")

    vec_env.seed(SEED)
    observations = vec_env.reset()
    begun = [single.reset(seed=SEED + i) for i, single in enumerate(singles)]
    for i, (env, name) in enumerate(places):
        assert_equal(row(observations, i), begun[env][0][name], f"first observation of slot {i}")
        assert_equal(vec_env.reset_infos[i], begun[env][1][name], f"first info of slot {i}")

    returns, ends = np.zeros(len(places)), 0
    for actions in actions_for(vec_env):
        observations, rewards, dones, infos = vec_env.step(actions)
        by_env = actions.reshape(worlds, len(names), -1)
        results = [
            single.step(dict(zip(names, own, strict=True)))
            for single, own in zip(singles, by_env, strict=True)
        ]
        over = not singles[0].agents
        nexts = [
            single.reset() if over else result
            for single, result in zip(singles, results, strict=True)
        ]
        ends += over
        assert rewards.dtype == np.float32
        assert dones.dtype == np.bool_
        for i, (env, name) in enumerate(places):
            seen, earned, _, truncated, told = (each[name] for each in results[env])
            returns[i] += earned
            assert_equal(row(observations, i), nexts[env][0][name], f"observation of slot {i}")
            np.testing.assert_allclose(rewards[i], earned, rtol=1e-6)
            assert dones[i] == truncated == over
            info = dict(infos[i])
            assert info.pop("TimeLimit.truncated") is over
            if over:
                assert_equal(info.pop("terminal_observation"), seen, f"last one of slot {i}")
                episode = info.pop("episode")
                assert episode["r"] == pytest.approx(returns[i], abs=2e-6)
                assert episode["l"] == SLOTS
                assert_equal(vec_env.reset_infos[i], nexts[env][1][name], f"next info of {i}")
            assert info.keys() == told.keys()
            for key, value in told.items():
                np.testing.assert_allclose(info[key], value, rtol=1e-12, err_msg=key)
        if over:
            returns[:] = 0
    assert ends == 2


@pytest.mark.parametrize("mask", ["none", "observation"])
def test_of_one_auv_it_plays_what_the_vector_environment_plays(mask):
    world = scenario(layout="episode", mask=mask)
    vec_env, vector = sb3_vec_env(world, WORLDS), AUVVectorEnv(world, WORLDS)
    assert_equal(vec_env.reset(SEED), vector.reset(seed=SEED)[0], "first observations")
    for actions in actions_for(vec_env):
        observations, rewards, dones, infos = vec_env.step(actions)
        expected, earned, _, truncations, told = vector.step(actions)
        assert_equal(observations, expected, "observations")
        np.testing.assert_array_equal(rewards, earned.astype(np.float32))
        np.testing.assert_array_equal(dones, truncations)
        if dones.all():
            finals = [info["terminal_observation"] for info in infos]
            assert_equal(finals, list(told["final_obs"]), "last observations")


@each_fleet
def test_it_plays_what_the_supersuit_route_plays(auvs):
    world = scenario("fdd", auvs, "episode", "info")
    native, supersuit = sb3_vec_env(world, WORLDS), supersuit_vec_env(world, WORLDS)
    native.seed(SEED)
    supersuit.seed(SEED)
    assert_equal(native.reset(), supersuit.reset(), "first observations")
    for actions in actions_for(native):
        np.testing.assert_array_equal(native.action_masks(), supersuit.action_masks())
        ours, theirs = native.step(actions), supersuit.step(actions)
        assert_equal(ours[0], theirs[0], "observations")
        np.testing.assert_allclose(ours[1], theirs[1], rtol=1e-6)
        np.testing.assert_array_equal(ours[2], theirs[2])
        for own, other in zip(ours[3], theirs[3], strict=True):
            for key in ("TimeLimit.truncated", "terminal_observation"):
                assert (key in own) == (key in other)
                np.testing.assert_array_equal(own.get(key), other.get(key))
    supersuit.close()


def wandering(observations):
    """A policy that heeds where the AUV is and charges and hears the node that its age names."""
    directions = (observations[..., :3].sum(axis=-1, keepdims=True) * 97 % 6).astype(int)
    nodes = (observations[..., 3:4] * 31 % 3).astype(int)
    return np.concatenate([directions, nodes, nodes], axis=-1)


def test_world_i_plays_the_episode_that_evaluate_counts_as_i():
    world = scenario(layout="episode")
    vec_env, seed, episodes = sb3_vec_env(world, 4), 20, 4
    vec_env.seed(seed)
    observations = vec_env.reset()
    for _ in range(SLOTS):
        actions = wandering(observations)
        observations, _, _, infos = vec_env.step(actions)
    found = iout_marl.evaluate(world, wandering, episodes, seed=seed).samples["mean_aoi"]
    np.testing.assert_allclose([info["time_mean_aoi"] for info in infos], found)


@each_fleet
def test_seeds_are_of_worlds_and_count_for_one_reset(auvs):
    vec_env = sb3_vec_env(scenario(auvs=auvs, layout="episode"), WORLDS)
    slots = [SEED + world for world in range(WORLDS) for _ in range(auvs)]
    assert vec_env.seed(SEED) == slots
    first = vec_env.reset()
    assert not np.array_equal(vec_env.reset(), first)
    vec_env.seed(SEED)
    np.testing.assert_array_equal(vec_env.reset(), first)
    np.testing.assert_array_equal(vec_env.reset(seed=SEED), first)


def test_without_a_seed_numpys_global_generator_draws_one_as_sb3_has_it():
    before = np.random.get_state()  # noqa: NPY002 (that is the one)
    vec_env = sb3_vec_env(scenario(layout="episode"), WORLDS)
    try:
        np.random.seed(3)  # noqa: NPY002
        first = vec_env.seed()
        np.random.seed(3)  # noqa: NPY002
        assert vec_env.seed() == first == [first[0] + i for i in range(WORLDS)]
    finally:
        np.random.set_state(before)  # noqa: NPY002


def test_worlds_without_a_seed_draw_layouts_of_their_own():
    observations = sb3_vec_env(scenario(layout="episode"), 8).reset()
    assert len(np.unique(observations, axis=0)) > 1


@pytest.mark.parametrize("bad", [-1, 0.5, "1", True])
def test_a_seed_that_is_none_is_refused(bad):
    vec_env = sb3_vec_env(scenario(), 2)
    for use in (vec_env.seed, vec_env.reset):
        with pytest.raises(InputError, match=r"^seed must be "):
            use(bad)
