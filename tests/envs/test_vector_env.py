"""The batched environment against single ones."""

import copy
import itertools
import pickle

import numpy as np
import pytest
from env_cases import CASES, SLOTS, case_scenario, scenario
from gymnasium import spaces
from gymnasium.vector import AutoresetMode

from iout_marl import load_scenario
from iout_marl.envs import AUVEnv, AUVVectorEnv
from iout_marl.errors import InputError
from iout_marl.testing import assert_equal, check_vector_env


def arrays_of(returned):
    """Every array of numbers in what `reset` or `step` returned."""
    if isinstance(returned, np.ndarray) and returned.dtype != object:
        return [returned]
    parts = returned.values() if isinstance(returned, dict) else returned
    return [
        array
        for part in parts
        if isinstance(part, dict | tuple | np.ndarray)
        for array in arrays_of(part)
    ]


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_batched_environment_does_what_gymnasium_does_with_single_ones(case):
    world = case_scenario(case)
    check_vector_env(lambda: AUVVectorEnv(world, 3), lambda: AUVEnv(world), seeds=(7,))


@pytest.mark.slow
@pytest.mark.parametrize("duplex", ["fdd", "tdd"])
def test_environment_i_is_the_single_one_seeded_so_over_two_episodes_of_the_paper(duplex):
    changes = {"nodes": {"kind": "random", "count": 5}, "observation.node_positions": True}
    world = load_scenario(f"paper/k5-{duplex}", changes)
    seed, envs = 40, 4
    batch, singles = AUVVectorEnv(world, envs), [AUVEnv(world) for _ in range(envs)]
    rng = np.random.default_rng(0)

    observations, _ = batch.reset(seed=seed)
    for i, single in enumerate(singles):
        assert_equal(observations[i], single.reset(seed=seed + i)[0], f"start of {i}")
    for slot in range(1, 2 * world.num_slots + 1):
        actions = rng.integers(0, np.tile(batch.single_action_space.nvec, (envs, 1)))
        observations, rewards, terminations, truncations, infos = batch.step(actions)
        last = slot % world.num_slots == 0
        assert truncations.tolist() == [last] * envs
        assert not terminations.any()
        assert ("final_obs" in infos) == ("final_info" in infos) == last
        for i, single in enumerate(singles):
            observation, reward, _, truncated, info = single.step(actions[i])
            assert rewards[i] == pytest.approx(reward, rel=1e-12)
            assert truncated == last
            if last:
                assert_equal(infos["final_obs"][i], observation, f"final observation of {i}")
                ended = {name: infos["final_info"][name][i].item() for name in info}
                assert_equal(ended, info, f"final info of {i}")
                observation, info = single.reset()
            assert_equal(observations[i], observation, f"slot {slot} of {i}")
            told = {name: infos[name][i].item() for name in info}
            assert_equal(told, info, f"slot {slot} of {i}")


@pytest.mark.parametrize("mask", ["info", "observation"])
def test_successive_slots_share_no_memory(mask):
    envs = AUVVectorEnv(scenario(auvs=3, mask=mask), 2)
    returned = [envs.reset(seed=0)]
    returned += [envs.step(envs.action_space.sample()) for _ in range(SLOTS + 2)]
    for earlier, later in itertools.pairwise(returned):
        for a, b in itertools.product(arrays_of(earlier), arrays_of(later)):
            assert not np.shares_memory(a, b)


@pytest.mark.parametrize("mask", ["info", "observation"])
def test_what_one_call_returns_shares_no_memory_with_itself(mask):
    envs = AUVVectorEnv(scenario(auvs=3, mask=mask), 2)
    returned = [envs.reset(seed=0)]
    returned += [envs.step(envs.action_space.sample()) for _ in range(SLOTS)]
    for one in returned:
        for a, b in itertools.combinations(arrays_of(one), 2):
            assert not np.shares_memory(a, b)


def test_batched_spaces_hold_what_is_returned():
    envs = AUVVectorEnv(scenario(auvs=3, mask="observation"), 2)
    assert isinstance(envs.observation_space, spaces.Dict)
    assert envs.reset(seed=0)[0] in envs.observation_space
    for _ in range(SLOTS + 1):
        assert envs.step(envs.action_space.sample())[0] in envs.observation_space


def test_seeds_may_be_given_one_by_one():
    world = scenario(layout="episode")
    envs = AUVVectorEnv(world, 3)
    observations, _ = envs.reset(seed=[5, 9, 5])
    np.testing.assert_array_equal(observations[0], observations[2])
    np.testing.assert_array_equal(observations[1], AUVEnv(world).reset(seed=9)[0])


@pytest.mark.parametrize("layout", ["episode", "run"])
def test_reseeding_one_environment_leaves_the_others_as_they_would_be(layout):
    world = scenario(layout=layout, **{"observation.node_positions": True})
    envs, singles = AUVVectorEnv(world, 2), [AUVEnv(world), AUVEnv(world)]
    for seeds in ([1, 2], [None, None], [3, None], [None, 4], [3, None]):
        observations, _ = envs.reset(seed=seeds)
        for i, single in enumerate(singles):
            np.testing.assert_array_equal(observations[i], single.reset(seed=seeds[i])[0])


def test_unseeded_environments_draw_layouts_of_their_own():
    observations, _ = AUVVectorEnv(scenario(layout="episode"), 8).reset()
    assert len(np.unique(observations, axis=0)) > 1


def test_a_layout_of_the_run_stays_over_episodes():
    envs = AUVVectorEnv(scenario(layout="run", **{"observation.node_positions": True}), 4)
    first, _ = envs.reset(seed=0)
    assert len(np.unique(first, axis=0)) > 1
    for _ in range(SLOTS):
        observations, *_ = envs.step(envs.action_space.sample())
    np.testing.assert_array_equal(observations, first)


def test_a_batch_can_be_copied_in_mid_episode():
    envs = AUVVectorEnv(scenario(layout="episode"), 3)
    envs.reset(seed=0)
    actions = [envs.action_space.sample() for _ in range(SLOTS + 2)]
    envs.step(actions[0])
    twins = [copy.deepcopy(envs), pickle.loads(pickle.dumps(envs))]
    expected = [envs.step(action) for action in actions]
    for twin in twins:
        assert_equal([twin.step(action) for action in actions], expected, "a copy")


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        ([[0, 0, 0]], r"shape \(2, 1, 3\)"),
        ([[0, 0], [0, 0]], "3 entries"),
        ([0, 0, 0], "3 entries"),
        ([[0, 0, 0], [6, 0, 0]], "outside"),
        ([[0, 0, 0], [0, 0, -1]], "outside"),
        ([[0.0, 0, 0], [0, 0, 0]], "integers"),
    ],
)
def test_actions_outside_their_space_are_refused(actions, message):
    envs = AUVVectorEnv(scenario(), 2)
    envs.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        envs.step(actions)


def test_wrong_number_of_seeds_is_refused():
    with pytest.raises(ValueError, match="expected 3 seeds, not 2"):
        AUVVectorEnv(scenario(), 3).reset(seed=[1, 2])


def test_partial_resets_are_refused():
    envs = AUVVectorEnv(scenario(), 2)
    with pytest.raises(ValueError, match="reset_mask"):
        envs.reset(options={"reset_mask": np.array([True, False])})


def test_step_before_reset_is_refused():
    with pytest.raises(RuntimeError, match="reset"):
        AUVVectorEnv(scenario(), 2).step([[0, 0, 0], [0, 0, 0]])


def test_render_shows_every_environment(capsys):
    world = scenario()
    for mode in ("human", "ansi", "rgb_array"):
        envs = AUVVectorEnv(world, 2, render_mode=mode)
        envs.reset(seed=0)
        pictures = envs.render()
        assert len(pictures) == 2
        if mode == "human":
            assert pictures == (None, None)
            assert capsys.readouterr().out.count("slot 0/") == 2
        elif mode == "ansi":
            assert all(isinstance(picture, str) for picture in pictures)
        else:
            assert all(picture.dtype == np.uint8 and picture.ndim == 3 for picture in pictures)
    assert AUVVectorEnv(world, 2).render() is None


# Autoreset modes ------------------------------------------------------------------------

MODES = pytest.mark.parametrize("mode", AutoresetMode, ids=lambda mode: mode.name)


@pytest.mark.slow
@MODES
@pytest.mark.parametrize("case", ["fdd-1-fixed-none", "tdd-3-episode-info", "fdd-3-run-none"])
def test_every_autoreset_mode_is_gymnasiums(mode, case):
    world = case_scenario(case)
    check_vector_env(
        lambda: AUVVectorEnv(world, 3, autoreset_mode=mode),
        lambda: AUVEnv(world),
        seeds=(7,),
        autoreset_mode=mode,
    )


@pytest.mark.slow
@MODES
@pytest.mark.parametrize("mask", ["none", "info", "observation"])
def test_every_autoreset_mode_with_masks(mode, mask):
    world = scenario("fdd", 3, "episode", mask)
    check_vector_env(
        lambda: AUVVectorEnv(world, 2, autoreset_mode=mode.value),
        lambda: AUVEnv(world),
        seeds=(3,),
        autoreset_mode=mode,
    )


def test_seeds_of_a_reset_of_some_are_theirs_alone():
    world = scenario(layout="episode")
    envs = AUVVectorEnv(world, 3, autoreset_mode="DISABLED")
    before, _ = envs.reset(seed=0)
    mask = np.array([False, True, False])
    after, infos = envs.reset(seed=[9, 5, 9], options={"reset_mask": mask})
    np.testing.assert_array_equal(after[[0, 2]], before[[0, 2]])
    np.testing.assert_array_equal(after[1], AUVEnv(world).reset(seed=5)[0])
    assert infos["_mean_aoi"].tolist() == mask.tolist()
    assert infos["mean_aoi"].tolist() == [0, 1, 0]


def test_a_step_after_the_end_without_a_reset_is_refused_by_number():
    envs = AUVVectorEnv(scenario(), 2, autoreset_mode="Disabled")
    envs.reset(seed=0)
    action = [[0, 0, 0]] * 2
    envs.step(action)
    envs.reset(options={"reset_mask": np.array([True, False])})
    for _ in range(SLOTS - 1):
        *_, truncations, _ = envs.step(action)
    assert truncations.tolist() == [False, True]
    with pytest.raises(RuntimeError, match=r"environments \[1\] are over: reset them first"):
        envs.step(action)


@pytest.mark.parametrize("mask", [[True, False], np.array([1, 0]), np.array([True]), None, "all"])
def test_what_is_no_reset_mask_is_refused(mask):
    envs = AUVVectorEnv(scenario(), 2, autoreset_mode="Disabled")
    envs.reset(seed=0)
    with pytest.raises(InputError, match="reset_mask'] must be a NumPy array of 2 bools"):
        envs.reset(options={"reset_mask": mask})


def test_the_first_reset_must_be_of_all():
    envs = AUVVectorEnv(scenario(), 2, autoreset_mode="Disabled")
    with pytest.raises(InputError, match="first reset must be of all"):
        envs.reset(options={"reset_mask": np.array([True, False])})


def test_a_batch_apart_can_be_drawn_and_copied():
    envs = AUVVectorEnv(scenario(layout="episode"), 2, "ansi", autoreset_mode="Disabled")
    envs.reset(seed=0)
    envs.step([[0, 0, 0]] * 2)
    envs.reset(options={"reset_mask": np.array([False, True])})
    texts = envs.render()
    assert "slot 1/" in texts[0]
    assert "slot 0/" in texts[1]
    twin = pickle.loads(pickle.dumps(envs))
    for _ in range(3):
        assert_equal(twin.step([[1, 1, 1]] * 2), envs.step([[1, 1, 1]] * 2), "a copy")
