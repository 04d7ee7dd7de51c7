"""SuperSuit, Stable-Baselines3 behind it, and TorchRL take the environments as they are."""

import numpy as np
import pytest
import supersuit
from env_cases import CASES, SLOTS, STARTS, case_scenario, scenario
from stable_baselines3 import PPO
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.vec_env import VecNormalize

from iout_marl import iout_v0
from iout_marl.envs import AUVEnv, supersuit_vec_env

#: Three different layouts are drawn for three copies, and can be told apart.
COPIES = 3
TINY_PPO = {"n_steps": 8, "batch_size": 8, "n_epochs": 1, "policy_kwargs": {"net_arch": [8]}}

pytestmark = [
    # Newer versions of Python warn of any fork beside threads, which SuperSuit's workers are.
    pytest.mark.filterwarnings("ignore:This process .* is multi-threaded:DeprecationWarning"),
    # TorchRL names the one version of PettingZoo that it is tested with.
    pytest.mark.filterwarnings("ignore:PettingZoo in TorchRL is tested using version"),
]


@pytest.fixture
def make_vec_env():
    """`supersuit_vec_env`, closed at the end of the test."""
    made = []

    def make(*args, **kwargs):
        made.append(supersuit_vec_env(*args, **kwargs))
        return made[-1]

    yield make
    for vec_env in made:
        vec_env.close()


@pytest.fixture(scope="module")
def torchrl_envs():
    """Imported where it is needed: that takes longer than to collect hundreds of tests."""
    import torchrl.envs

    return torchrl.envs


def play(vec_env, slots, seed=0):
    rng = np.random.default_rng(seed)
    sizes = np.tile(vec_env.action_space.nvec, (vec_env.num_envs, 1))
    return [vec_env.step(rng.integers(0, sizes)) for _ in range(slots)]


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
# What it says of node tables, which it flattens.
@pytest.mark.filterwarnings("ignore:Your observation .* has an unconventional shape")
def test_joint_environment_passes_sb3s_checker(case):
    check_env(AUVEnv(case_scenario(case)))


@pytest.mark.slow
@pytest.mark.parametrize("processes", [0, 1, 2])
@pytest.mark.parametrize("auvs", STARTS)
def test_ppo_learns_through_supersuit(make_vec_env, auvs, processes):
    vec_env = make_vec_env(scenario("fdd", auvs, "episode"), COPIES, processes)
    assert vec_env.num_envs == COPIES * auvs
    model = PPO("MlpPolicy", vec_env, seed=0, **TINY_PPO)
    before = [parameter.clone() for parameter in model.policy.parameters()]
    model.learn(2 * 8 * COPIES * auvs)
    assert any((a != b).any() for a, b in zip(before, model.policy.parameters(), strict=True))


@pytest.mark.parametrize(("duplex", "mask"), [("tdd", "info"), ("tdd", "observation")])
def test_ppo_learns_beside_action_masks(make_vec_env, duplex, mask):
    policy = "MultiInputPolicy" if mask == "observation" else "MlpPolicy"
    vec_env = make_vec_env(scenario(duplex, 1, mask=mask), COPIES)
    PPO(policy, vec_env, **TINY_PPO).learn(8 * COPIES)


@pytest.mark.slow
@pytest.mark.parametrize("processes", [0, 1, 2])
def test_copy_i_is_the_environment_seeded_with_seed_plus_i(make_vec_env, processes):
    auvs, seed = 3, 11
    world = scenario("fdd", auvs, "episode")
    observations = make_vec_env(world, COPIES, processes).reset(seed=seed)
    for i in range(COPIES):
        single, _ = iout_v0.parallel_env(world).reset(seed=seed + i)
        expected = np.stack(list(single.values()))
        np.testing.assert_array_equal(observations[i * auvs : (i + 1) * auvs], expected)


@pytest.mark.slow
@pytest.mark.parametrize("processes", [0, 2])
def test_reset_by_a_seed_repeats_and_without_one_goes_on(make_vec_env, processes):
    vec_env = make_vec_env(scenario("tdd", 1, "episode"), COPIES, processes)
    first = vec_env.reset(seed=3)
    slots = play(vec_env, SLOTS + 2)
    assert not np.array_equal(vec_env.reset(), first)
    np.testing.assert_array_equal(vec_env.reset(seed=3), first)
    for a, b in zip(slots, play(vec_env, SLOTS + 2), strict=True):
        np.testing.assert_equal(a, b)
    assert vec_env.seed(3) == [3, 4, 5]
    np.testing.assert_array_equal(vec_env.reset(), first)
    assert not np.array_equal(vec_env.reset(), first)


@pytest.mark.slow
def test_number_of_processes_changes_nothing(make_vec_env):
    world = scenario("fdd", 3, "episode")
    played = []
    for processes in (0, 1, 2):
        vec_env = make_vec_env(world, COPIES, processes)
        played.append([vec_env.reset(seed=5), vec_env.reset_infos, *play(vec_env, SLOTS + 2)])
    for other in played[1:]:
        np.testing.assert_equal(other, played[0])


@pytest.mark.slow
@pytest.mark.parametrize("processes", [0, 2])
def test_last_slot_is_told_as_a_time_limit(make_vec_env, processes):
    vec_env = make_vec_env(scenario(), COPIES, processes)
    vec_env.reset(seed=0)
    for slot, (_, _, dones, infos) in enumerate(play(vec_env, SLOTS), start=1):
        assert dones.tolist() == [slot == SLOTS] * COPIES
        assert [info["TimeLimit.truncated"] for info in infos] == [slot == SLOTS] * COPIES
        assert all(("terminal_observation" in info) == (slot == SLOTS) for info in infos)


def test_copies_without_a_seed_draw_layouts_of_their_own(make_vec_env):
    observations = make_vec_env(scenario(layout="episode"), 8).reset()
    assert len(np.unique(observations, axis=0)) > 1


@pytest.mark.slow
@pytest.mark.parametrize("processes", [0, 2])
def test_sb3s_wrappers_take_the_environment_without_a_warning(make_vec_env, processes):
    vec_env = VecNormalize(make_vec_env(scenario(), COPIES, processes))
    assert vec_env.render_mode is None
    assert np.isfinite(vec_env.reset()).all()


@pytest.mark.slow
@pytest.mark.parametrize("processes", [0, 1, 2])
@pytest.mark.parametrize(("auvs", "mask"), [(1, "observation"), (3, "info")])
def test_supersuits_own_vector_environment_plays(auvs, mask, processes):
    world = scenario("tdd", auvs, "episode", mask)
    single = supersuit.pettingzoo_env_to_vec_env_v1(iout_v0.parallel_env(world))
    assert single.num_envs == auvs
    envs = supersuit.concat_vec_envs_v1(single, COPIES, num_cpus=processes)
    try:
        envs.reset(seed=1)
        rng = np.random.default_rng(0)
        sizes = np.tile(single.action_space.nvec, (COPIES * auvs, 1))
        for slot in range(1, SLOTS + 3):
            _, rewards, terminations, truncations, infos = envs.step(rng.integers(0, sizes))
            assert rewards.shape == (COPIES * auvs,)
            assert np.isfinite(rewards).all()
            assert not np.any(terminations)
            assert np.array(truncations, dtype=bool).tolist() == [slot == SLOTS] * len(rewards)
            assert all("mean_aoi" in info for info in infos)
    finally:
        envs.close()


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_torchrl_takes_the_environment(case, torchrl_envs):
    env = iout_v0.parallel_env(case_scenario(case))
    torchrl_envs.check_env_specs(torchrl_envs.PettingZooWrapper(env, return_state=True))


def test_torchrl_rolls_out_whole_episodes(torchrl_envs):
    env = iout_v0.parallel_env(scenario(auvs=3))
    rollout = torchrl_envs.PettingZooWrapper(env, return_state=True).rollout(SLOTS + 5)
    assert rollout.shape == (SLOTS,)
    assert rollout["next", "auv", "truncated"][-1].all()
    assert not rollout["next", "auv", "terminated"].any()
    assert rollout["state"].shape == (SLOTS, *env.state_space.shape)
