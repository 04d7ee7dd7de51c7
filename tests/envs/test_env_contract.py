"""The contract of the design page: names, spaces, infos, ends, errors, render modes."""

import copy
import pickle

import numpy as np
import pettingzoo
import pytest
from env_cases import CASES, SLOTS, STARTS, case_scenario, scenario
from gymnasium import spaces

from iout_marl import InputError, bundled_names, iout_v0, load_scenario
from iout_marl.envs import AUVEnv, AUVParallelEnv, AUVVectorEnv
from iout_marl.envs.episodes import INFO_KEYS

#: Two AUVs at the only node, charging and hearing it: the first one gets its packet.
AT_THE_NODE = {
    "nodes.cells": [[5, 5, 2], [9, 9, 4], [1, 1, 4]],
    "auvs.start_cells": [[5, 5, 1], [5, 5, 3]],
}


def random_actions(env, rng):
    return {a: rng.integers(0, env.action_space(a).nvec) for a in env.agents}


def play(env, seed=0):
    """Whatever `reset` and every `step` of an episode return, as (observations, …, infos)."""
    rng = np.random.default_rng(seed)
    yield env.reset(seed=seed)
    while env.agents:
        yield env.step(random_actions(env, rng))


# What is offered ------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", bundled_names())
def test_bundled_scenario_plays_an_episode(name):
    env = iout_v0.parallel_env(name)
    scenario = env.scenario
    nodes = [scenario.num_nodes + scenario.auvs.idle_choices]
    nodes *= 2 if scenario.duplex.kind == "fdd" else 1
    directions = {"six": 6, "planar": 5, "hover": 7}[scenario.auvs.motion.kind]
    assert env.action_space("auv_0") == spaces.MultiDiscrete([directions, *nodes])
    *_, (_, _, _, truncations, _) = play(env)
    assert truncations == dict.fromkeys(env.possible_agents, True)


def test_default_scenario_is_the_papers_with_ten_nodes():
    for form in (iout_v0.parallel_env, AUVEnv):
        assert form().scenario == load_scenario("paper/k10-fdd")


def test_scenario_may_be_a_path(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("extends: paper/k3-tdd\n")
    for source in (path, str(path)):
        assert iout_v0.parallel_env(source).scenario.num_nodes == 3


@pytest.mark.parametrize("make", [iout_v0.parallel_env, iout_v0.env, iout_v0.raw_env, AUVEnv])
def test_unknown_scenario_is_refused_with_what_was_meant(make):
    with pytest.raises(InputError, match="did you mean 'paper/k3-fdd'"):
        make(scenario="paper/k3-fd")


def test_registry_makes_both_forms():
    parallel = pettingzoo.make("parallel", "iout/AUV-v0", scenario="paper/k3-fdd")
    assert isinstance(parallel, AUVParallelEnv)
    aec = pettingzoo.make("aec", "iout/AUV-v0", scenario="paper/k3-fdd", render_mode="ansi")
    assert isinstance(aec, pettingzoo.AECEnv)
    assert aec.render_mode == "ansi"
    for env in (parallel, aec):
        assert env.unwrapped.possible_agents == ["auv_0"]
        assert env.observation_space("auv_0").shape == (9,)


def test_forms_are_those_that_pettingzoo_knows():
    assert isinstance(iout_v0.parallel_env(), pettingzoo.ParallelEnv)
    assert isinstance(iout_v0.raw_env(), pettingzoo.AECEnv)
    assert isinstance(iout_v0.env(), pettingzoo.AECEnv)
    assert iout_v0.env().unwrapped.metadata["is_parallelizable"]
    assert iout_v0.parallel_env().metadata["name"] == "iout_v0"
    assert str(iout_v0.parallel_env()) == "iout_v0"


# Agents and spaces ----------------------------------------------------------------------


@pytest.mark.parametrize("auvs", STARTS)
def test_agents_are_numbered_from_zero(auvs):
    env = iout_v0.parallel_env(scenario(auvs=auvs))
    assert env.possible_agents == [f"auv_{i}" for i in range(auvs)]
    assert env.agents == []
    env.reset(seed=0)
    assert env.agents == env.possible_agents


@pytest.mark.parametrize(("duplex", "sizes"), [("fdd", [6, 3, 3]), ("tdd", [6, 3])])
@pytest.mark.parametrize("mask", ["none", "info", "observation"])
def test_action_is_a_direction_and_a_node_for_each_band(duplex, sizes, mask):
    env = iout_v0.parallel_env(scenario(duplex, 3, mask=mask))
    for agent in env.possible_agents:
        assert env.action_space(agent) == spaces.MultiDiscrete(sizes)


def test_spaces_are_one_object_of_each_agents_own():
    env = iout_v0.parallel_env(scenario(auvs=3, mask="observation"))
    for space_of in (env.action_space, env.observation_space):
        assert space_of("auv_1") is space_of("auv_1")
        assert space_of("auv_1") is not space_of("auv_0")
    env.action_space("auv_0").seed(0)
    first = env.action_space("auv_0").sample()
    env.action_space("auv_0").seed(0)
    env.action_space("auv_1").seed(1)
    env.action_space("auv_1").sample()
    np.testing.assert_array_equal(env.action_space("auv_0").sample(), first)


@pytest.mark.parametrize("case", CASES)
def test_bounds_of_observation_and_state_are_finite(case):
    env = iout_v0.parallel_env(case_scenario(case))
    space = env.observation_space("auv_0")
    named = dict(space) if isinstance(space, spaces.Dict) else {"observation": space}
    named.pop("action_mask", None)
    for box in (*named.values(), env.state_space):
        assert box.dtype == np.float32
        assert np.isfinite(box.low).all()
        assert np.isfinite(box.high).all()


def test_observation_is_position_ages_and_energies():
    world = load_scenario("paper/k3-fdd", AT_THE_NODE)
    env = iout_v0.parallel_env(world)
    observations, _ = env.reset(seed=0)
    np.testing.assert_array_equal(observations["auv_0"], [5, 5, 1, 1, 1, 1, 0, 0, 0, 0, 0, 2])
    np.testing.assert_array_equal(observations["auv_1"], [5, 5, 3, 1, 1, 1, 0, 0, 0, 0, 0, -2])
    # Up into the node's cell, charging node 0, hearing node 0; down and charging node 1.
    actions = {"auv_0": np.array([4, 0, 0]), "auv_1": np.array([1, 1, 1])}
    observations, _, _, _, infos = env.step(actions)
    harvested = [infos[agent]["harvested_j"] for agent in env.agents]
    observed = observations["auv_0"]
    np.testing.assert_array_equal(observed[:3], [5, 5, 2])
    np.testing.assert_array_equal(observations["auv_1"][:3], [4, 5, 3])
    assert infos["auv_0"]["delivered"] == 1
    np.testing.assert_array_equal(observed[3:6], [1, 2, 2])
    assert 0 < observed[6] < harvested[0]
    np.testing.assert_allclose(observed[7], harvested[1], rtol=1e-6)
    assert observed[8] == 0
    np.testing.assert_array_equal(observed[9:], [-1, 0, 1])
    np.testing.assert_array_equal(observations["auv_1"][3:9], observed[3:9])


def test_scaled_observation_is_position_ages_energies_nodes_time_and_team():
    world = scenario(layout="episode", auvs=3)
    env = iout_v0.parallel_env(world)
    space = env.observation_space("auv_0")
    assert space.shape == (3 + 3 + 3 + 9 + 1 + 2 * 3 + 3 + 3,)
    np.testing.assert_array_equal(space.low, [0] * 19 + [-1] * 6 + [0] * 6)
    np.testing.assert_array_equal(space.high, 1)
    for slot, (observations, *_) in enumerate(play(env)):
        for auv, observation in enumerate(observations.values()):
            assert observation[18] == np.float32(slot / SLOTS)
            assert observation[28:].tolist() == [auv == 0, auv == 1, auv == 2]
    # The state is scaled alike, and tells the same nodes.
    state = env.state()
    np.testing.assert_array_equal(env.state_space.high, 1)
    np.testing.assert_array_equal(state[-10:-1], observations["auv_0"][9:18])
    places = env.scenario.num_slots, env.scenario.age.maximum
    ages, deliveries = state[9:12] * places[1], state[15:18] * places[0]
    np.testing.assert_allclose(ages, np.rint(ages), atol=1e-4)
    np.testing.assert_allclose(deliveries, np.rint(deliveries), atol=1e-4)


@pytest.mark.parametrize("auvs", STARTS)
def test_state_is_what_all_auvs_see_and_more(auvs):
    env = iout_v0.parallel_env(scenario(auvs=auvs))
    assert env.state_space.shape == (3 * auvs + 6 * 3 + 1,)
    for slot, (observations, *_) in enumerate(play(env)):
        state = env.state()
        positions = [observation[:3] for observation in observations.values()]
        np.testing.assert_array_equal(state[: 3 * auvs], np.concatenate(positions))
        np.testing.assert_array_equal(state[3 * auvs : 3 * auvs + 6], observations["auv_0"][3:9])
        assert state[-1] == np.float32(slot / SLOTS)
        assert env.state_space.contains(state)


# Infos ----------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_infos_have_the_same_numeric_keys_from_reset_on(case):
    env = iout_v0.parallel_env(case_scenario(case))
    masked = env.scenario.observation.action_mask == "info"
    for *_, infos in play(env):
        for info in infos.values():
            assert list(info) == [*INFO_KEYS, *(["action_mask"] if masked else [])]
            assert all(type(info[name]) is float for name in INFO_KEYS)


def test_infos_of_a_reset_tell_that_nothing_has_happened():
    _, infos = iout_v0.parallel_env(scenario("tdd", 3)).reset(seed=0)
    for info in infos.values():
        ages = {"aoi_now", "mean_aoi", "time_mean_aoi"}
        assert {name: info[name] for name in ages} == dict.fromkeys(ages, 1)
        others = set(INFO_KEYS) - ages
        assert {name: info[name] for name in others} == dict.fromkeys(others, 0)


def test_observation_ranges_are_those_of_each_environments_observations():
    world = scenario("fdd", 3)
    own = iout_v0.parallel_env(world).observation_ranges
    assert own.scale.shape == iout_v0.parallel_env(world).observation_space("auv_0").shape
    for env in (AUVEnv(world), AUVVectorEnv(world, 3)):
        space = getattr(env, "single_observation_space", env.observation_space)
        ranges = env.observation_ranges
        assert ranges.scale.shape == ranges.low.shape == space.shape
        assert (ranges.scale == np.tile(own.scale, 3)).all()
        assert np.allclose(ranges.high, space.high, rtol=1e-6)


@pytest.mark.parametrize("duplex", ["fdd", "tdd"])
@pytest.mark.parametrize("auvs", STARTS)
def test_infos_follow_from_the_observations(duplex, auvs):
    env = iout_v0.parallel_env(scenario(duplex, auvs, **{"age.maximum": 4}))
    mean_ages, peak, total_j, deliveries = [], 0, 0.0, 0
    _, *slots = play(env)
    for observations, *_, infos in slots:
        ages, stored_j = np.split(observations["auv_0"][3:9].astype(float), 2)
        mean_ages.append(ages.mean())
        peak = max(peak, ages.max())
        total_j += sum(info["harvested_j"] for info in infos.values())
        deliveries += sum(info["delivered"] for info in infos.values())
        for info in infos.values():
            assert info["aoi_now"] == info["mean_aoi"] == pytest.approx(mean_ages[-1])
            assert info["time_mean_aoi"] == pytest.approx(np.mean(mean_ages))
            assert info["peak_aoi"] == peak
            assert info["total_harvested_j"] == pytest.approx(total_j)
            spent_j = pytest.approx(total_j - stored_j.sum(), abs=1e-5 * (1 + total_j))
            assert info["total_spent_j"] == spent_j
            assert (info["jain"] > 0) == (deliveries > 0)
            assert info["delivered"] in (0, 1)
            assert info["beta"] == 0 or duplex == "tdd"
    assert deliveries > 0 or auvs == 1
    assert info["age_violations"] > 0


def test_beta_is_told_in_tdd():
    world = load_scenario("paper/k3-tdd", AT_THE_NODE)
    env = iout_v0.parallel_env(world)
    env.reset(seed=0)
    *_, infos = env.step({"auv_0": [4, 0], "auv_1": [5, 1]})
    assert 0 < infos["auv_0"]["beta"] <= 1
    assert infos["auv_0"]["delivered"] == (infos["auv_0"]["beta"] < 1)


# Ends, streams and copies ---------------------------------------------------------------


@pytest.mark.parametrize("duplex", ["fdd", "tdd"])
@pytest.mark.parametrize("auvs", STARTS)
def test_all_agents_are_truncated_together_at_the_last_slot_and_only_then(duplex, auvs):
    env = iout_v0.parallel_env(scenario(duplex, auvs))
    _, *slots = play(env)
    assert len(slots) == SLOTS
    for slot, (_, _, terminations, truncations, _) in enumerate(slots, start=1):
        assert terminations == dict.fromkeys(env.possible_agents, False)
        assert truncations == dict.fromkeys(env.possible_agents, slot == SLOTS)
    assert env.agents == []


def test_episode_of_the_paper_has_a_hundred_slots():
    assert len(list(play(iout_v0.parallel_env("paper/k3-fdd")))) == 1 + 100


def test_layouts_of_episodes_follow_from_the_seed_and_differ():
    env = iout_v0.parallel_env(scenario(layout="episode"))
    first, again = ([env.reset(seed=s)[0]["auv_0"] for s in (0, None, None)] for _ in range(2))
    np.testing.assert_array_equal(first, again)
    assert len(np.unique(first, axis=0)) == 3


def test_layout_of_the_run_follows_from_the_last_seed_given():
    env = iout_v0.parallel_env(scenario(layout="run", **{"observation.node_positions": True}))
    first, other, again = ([env.reset(seed=s)[0]["auv_0"] for s in (i, None)] for i in (0, 1, 0))
    for one, next_one in (first, other, again):
        np.testing.assert_array_equal(one, next_one)
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_copies_of_an_environment_never_reset_draw_layouts_of_their_own():
    env = iout_v0.parallel_env(scenario(layout="episode"))
    pickled = pickle.dumps(env)
    copies = [env, copy.deepcopy(env), pickle.loads(pickled), pickle.loads(pickled)]
    observations = [twin.reset()[0]["auv_0"] for twin in copies]
    assert len(np.unique(observations, axis=0)) == len(copies)


@pytest.mark.parametrize("make", [iout_v0.env, iout_v0.raw_env, AUVEnv])
def test_every_face_can_be_copied_in_mid_episode(make):
    def next_episode(env):
        env.step(np.array([0, 1, 1]))
        returned = env.reset()
        return returned[0] if make is AUVEnv else env.observe("auv_0")

    env = make(scenario(layout="episode"))
    env.reset(seed=0)
    env.step(np.array([0, 1, 1]))
    twins = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    expected = next_episode(env)
    for twin in twins:
        np.testing.assert_array_equal(next_episode(twin), expected)


# Errors ---------------------------------------------------------------------------------

BAD_ACTIONS = {
    "direction out of range": ([6, 0, 0], r"\[6, 0, 0\] lies outside MultiDiscrete\(\[6, 3, 3\]\)"),
    "node out of range": ([0, 0, 3], "lies outside"),
    "negative": ([0, -1, 0], "lies outside"),
    "float": ([0.0, 0.0, 0.0], "must be integers"),
    "bool": ([True, False, True], "must be integers"),
    "None": (None, "must be integers"),
    "text": ("000", "must be integers"),
    "ragged": ([0, [0, 0], 0], "must be integers"),
    "too short": ([0, 0], r"must have (shape \(3,\)|3 entries)"),
    "too long": ([0, 0, 0, 0], r"must have (shape \(3,\)|3 entries)"),
    "a number": (0, r"must have (shape \(3,\)|3 entries)"),
    "nested": ([[0, 0, 0]], r"must have (shape \(3,\)|3 entries)"),
}


@pytest.mark.parametrize("auvs", STARTS)
@pytest.mark.parametrize(("action", "message"), BAD_ACTIONS.values(), ids=BAD_ACTIONS)
def test_action_outside_its_space_is_refused_and_changes_nothing(auvs, action, message):
    env = iout_v0.parallel_env(scenario(auvs=auvs))
    env.reset(seed=0)
    before = env.state()
    good = {agent: np.array([0, 0, 0]) for agent in env.agents}
    with pytest.raises(ValueError, match=message):
        env.step(good | {f"auv_{auvs - 1}": action})
    np.testing.assert_array_equal(env.state(), before)
    assert env.agents == env.possible_agents
    env.step(good)


@pytest.mark.parametrize(("action", "message"), BAD_ACTIONS.values(), ids=BAD_ACTIONS)
def test_joint_action_outside_its_space_is_refused(action, message):
    env = AUVEnv(scenario())
    env.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        env.step(action)


def test_missing_actions_are_refused_by_name():
    env = iout_v0.parallel_env(scenario(auvs=3))
    env.reset(seed=0)
    with pytest.raises(ValueError, match="no action for auv_0, auv_2"):
        env.step({"auv_1": [0, 0, 0]})


@pytest.mark.parametrize("dtype", [np.int8, np.uint8, np.int32, np.int64, list, tuple])
def test_actions_may_be_of_any_integer_type(dtype):
    env = iout_v0.parallel_env(scenario())
    env.reset(seed=0)
    action = dtype([5, 2, 2]) if dtype in (list, tuple) else np.array([5, 2, 2], dtype=dtype)
    observations, *_ = env.step({"auv_0": action})
    np.testing.assert_array_equal(observations["auv_0"][:3], [5, 5, 1])


@pytest.mark.parametrize("observation", ["entries", "table"])
@pytest.mark.parametrize("make", [AUVEnv, AUVParallelEnv, lambda s: AUVVectorEnv(s, num_envs=2)])
def test_what_was_done_stays_whatever_becomes_of_the_callers_array(make, observation):
    overrides = {} if observation == "entries" else {"observation": {"kind": observation}}
    env = make(load_scenario("paper/k3-fdd", overrides))
    env.reset(seed=0)
    is_parallel = isinstance(env, AUVParallelEnv)
    action = np.zeros_like(
        env.action_space("auv_0").sample() if is_parallel else env.action_space.sample()
    )
    env.step({"auv_0": action} if is_parallel else action)
    before = env.episodes.last_events.heard.copy()
    action[:] = 2
    assert (env.episodes.last_events.heard == before).all()


@pytest.mark.parametrize("make", [iout_v0.parallel_env, AUVEnv])
def test_step_before_reset_is_refused(make):
    with pytest.raises(RuntimeError, match=r"reset\(\) first"):
        make(scenario()).step({"auv_0": [0, 0, 0]} if make is not AUVEnv else [0, 0, 0])


@pytest.mark.parametrize("make", [iout_v0.parallel_env, AUVEnv])
def test_step_after_the_end_is_refused_until_a_reset(make):
    env = make(scenario())
    action = [0, 0, 0] if make is AUVEnv else {"auv_0": [0, 0, 0]}
    env.reset(seed=0)
    for _ in range(SLOTS):
        env.step(action)
    with pytest.raises(RuntimeError, match=r"reset\(\) first"):
        env.step(action)
    env.reset()
    env.step(action)


def test_state_before_reset_is_refused():
    with pytest.raises(RuntimeError, match=r"reset\(\) first"):
        iout_v0.parallel_env(scenario()).state()


def test_aec_form_refuses_actions_outside_their_space():
    env = iout_v0.env(scenario())
    env.reset(seed=0)
    with pytest.raises(AssertionError, match="not in action space"):
        env.step(np.array([6, 0, 0]))


# Rendering ------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [iout_v0.parallel_env, iout_v0.env, iout_v0.raw_env, AUVEnv])
def test_render_gives_what_its_mode_names(make, capsys):
    for mode in (None, "human", "ansi"):
        env = make(scenario(), render_mode=mode)
        assert env.render_mode == mode
        env.reset(seed=0)
        shown = capsys.readouterr().out
        picture = env.render()
        assert isinstance(picture, str) if mode == "ansi" else picture is None
        assert ("slot 0/" in shown) == (mode == "human")
        env.close()


@pytest.mark.slow
def test_pixels_are_a_picture_of_the_slot():
    env = iout_v0.parallel_env(scenario(auvs=3), render_mode="rgb_array")
    env.reset(seed=0)
    first = env.render()
    assert first.dtype == np.uint8
    assert first.ndim == 3
    assert first.shape[2] == 3
    env.step(random_actions(env, np.random.default_rng(0)))
    second = env.render()
    assert second.shape == first.shape
    assert (second != first).any()


@pytest.mark.parametrize("make", [iout_v0.parallel_env, iout_v0.env, AUVEnv])
def test_unknown_render_mode_is_refused(make):
    with pytest.raises(InputError, match="render_mode must be one of"):
        make(scenario(), render_mode="ascii")


@pytest.mark.parametrize("mode", ["ansi", "rgb_array"])
def test_render_before_reset_is_refused(mode):
    with pytest.raises(RuntimeError, match=r"reset\(\) first"):
        iout_v0.parallel_env(scenario(), render_mode=mode).render()


@pytest.mark.parametrize("make", [iout_v0.parallel_env, iout_v0.env, AUVEnv])
def test_close_may_be_called_at_any_time(make):
    env = make(scenario())
    env.close()
    env.reset(seed=0)
    env.close()
    env.close()
