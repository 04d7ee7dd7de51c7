"""The batched VecEnv keeps to what Stable-Baselines3's own tests ask of vectorised environments."""

import copy
import pickle
import sys

import numpy as np
import pytest
from env_cases import CASES, SLOTS, case_scenario, scenario
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecCheckNan, VecFrameStack, VecNormalize
from vec_env_cases import actions_for, played, row, without_seconds

from iout_marl import InputError
from iout_marl.envs import AUVEnv, sb3_vec_env, supersuit_vec_env
from iout_marl.testing import assert_equal

SEED = 7

each_case = pytest.mark.parametrize("case", CASES)


@pytest.mark.parametrize("wrap", [None, VecNormalize, VecFrameStack, VecCheckNan])
def test_attributes_and_methods_of_slots_are_reached(wrap):
    vec_env = sb3_vec_env(scenario(auvs=3), 2)
    if wrap is not None:
        vec_env = wrap(vec_env, n_stack=2) if wrap is VecFrameStack else wrap(vec_env)
    vec_env.seed(0)
    vec_env.reset()
    assert vec_env.get_attr("agent") == ["auv_0", "auv_1", "auv_2"] * 2
    assert vec_env.get_attr("world", indices=[0, -1]) == [0, 1]
    assert vec_env.get_attr("spec", indices=2) == [None]
    assert vec_env.get_attr("scenario")[0].num_auvs == 3
    assert vec_env.get_attr("action_space")[0] == vec_env.action_space
    assert vec_env.get_attr("observation_space")[5] == vec_env.unwrapped.observation_space
    assert vec_env.get_attr("observation_ranges", 0)[0] is vec_env.unwrapped.observation_ranges
    assert vec_env.get_attr("metadata")[0]["render_fps"] > 0
    assert vec_env.get_attr("render_mode") == [None] * 6
    assert vec_env.env_method("render") == [None] * 6

    assert vec_env.set_attr("mine", 42) is None
    vec_env.set_attr("mine", 12, indices=[0, -1])
    assert vec_env.get_attr("mine") == [12, 42, 42, 42, 42, 12]
    assert vec_env.get_attr("mine", indices=-1) == [12]
    assert not vec_env.has_attr("nowhere")
    with pytest.raises(AttributeError, match="nowhere"):
        vec_env.get_attr("nowhere")
    for own in ("scenario", "world", "spec", "action_masks"):
        with pytest.raises(AttributeError, match=f"^'{own}' is what a slot is"):
            vec_env.set_attr(own, None)
    assert vec_env.env_is_wrapped(AUVEnv) == [False] * 6
    assert vec_env.env_is_wrapped(Monitor, indices=[0, 1]) == [True] * 2
    vec_env.close()


@pytest.mark.slow
@each_case
def test_what_is_handed_out_lies_in_its_space_and_is_of_its_type(case):
    vec_env = sb3_vec_env(case_scenario(case), 2)
    space = vec_env.observation_space
    seen = [vec_env.reset()]
    for actions in actions_for(vec_env, SLOTS):
        observations, _, dones, infos = vec_env.step(actions)
        seen.append(observations)
    assert dones.all()
    for observations in seen:
        assert all(space.contains(row(observations, i)) for i in range(vec_env.num_envs))
    assert all(space.contains(info["terminal_observation"]) for info in infos)


def test_what_was_handed_out_does_not_change_afterwards():
    vec_env = sb3_vec_env(scenario(auvs=3, mask="observation"), 2)
    first = vec_env.reset(0)
    kept = copy.deepcopy(first)
    masks = vec_env.action_masks()
    kept_masks = masks.copy()
    steps = [vec_env.step(actions) for actions in actions_for(vec_env)]
    kept_steps = copy.deepcopy(steps[0])
    vec_env.reset()
    assert_equal(first, kept, "observations of the reset")
    np.testing.assert_array_equal(masks, kept_masks)
    assert_equal(steps[0], kept_steps, "the first slot")


def test_writing_into_what_was_handed_out_changes_nothing():
    world = scenario(auvs=3, mask="info")
    clean, spoilt = sb3_vec_env(world, 2), sb3_vec_env(world, 2)
    clean.reset(0)
    spoilt.reset(0)[:] = -1
    for actions in actions_for(clean):
        for mask in (spoilt.action_masks(), *spoilt.env_method("action_masks")):
            mask[:] = False
        np.testing.assert_array_equal(spoilt.action_masks(), clean.action_masks())
        expected, found = clean.step(actions), spoilt.step(actions)
        assert_equal(without_seconds(found[3]), without_seconds(expected[3]), "infos")
        assert_equal(found[:3], expected[:3], "what the slot brought")
        for info in found[3]:
            info["action_mask"][:] = 0
        found[0][:], found[1][:] = -1, -1


def test_steps_need_a_reset_and_actions():
    vec_env = sb3_vec_env(scenario(), 2)
    with pytest.raises(RuntimeError, match=r"call step_async\(\) first"):
        vec_env.step_wait()
    with pytest.raises(RuntimeError, match=r"call reset\(\) first"):
        vec_env.step(np.zeros((2, 3), dtype=int))
    with pytest.raises(RuntimeError, match=r"call reset\(\) first"):
        vec_env.action_masks()


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        (np.zeros((2, 3), dtype=int), r"actions must have shape \(6, 3\), not \(2, 3\)"),
        (np.zeros((6, 2), dtype=int), r"actions must have shape \(6, 3\), not \(6, 2\)"),
        (np.zeros((6, 3)), r"an action must be integers"),
        (np.full((6, 3), 99), r"environment 0, auv_0: action \[99, 99, 99\] lies outside"),
    ],
)
def test_actions_outside_their_space_are_refused(actions, message):
    vec_env = sb3_vec_env(scenario(auvs=3), 2)
    vec_env.reset()
    with pytest.raises(InputError, match=message):
        vec_env.step(actions)


@pytest.mark.slow
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@pytest.mark.parametrize("slots", [0, 4, SLOTS])
def test_a_copy_goes_on_as_the_original_does(copied, slots):
    vec_env = sb3_vec_env(scenario(auvs=3, layout="episode", mask="info"), 2)
    vec_env.reset(SEED)
    played(vec_env, slots)
    vec_env.set_attr("mine", 1, indices=3)
    twin = copied(vec_env)
    assert twin.get_attr("mine", indices=3) == [1]
    np.testing.assert_array_equal(twin.action_masks(), vec_env.action_masks())
    assert_equal(played(twin), played(vec_env), "what follows")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:You tried to call render:UserWarning")
def test_pictures_are_of_the_worlds(capsys):
    world = scenario(auvs=3)
    vec_env = sb3_vec_env(world, 2, render_mode="rgb_array")
    vec_env.reset(0)
    single = AUVEnv(world, render_mode="rgb_array")
    single.reset(seed=0)
    images, picture = vec_env.get_images(), single.render()
    assert len(images) == vec_env.num_envs == 6
    for image in images:
        np.testing.assert_array_equal(image, picture)
    height, width, _ = images[0].shape
    # Stable-Baselines3 lays six pictures out in three rows of two.
    assert vec_env.render().shape == (3 * height, 2 * width, 3)
    with pytest.warns(UserWarning, match="render modes are determined"):
        vec_env.render(mode="ansi")

    plain = sb3_vec_env(world, 2)
    plain.reset()
    assert plain.get_images() == [None] * 6
    assert plain.render() is None

    texts = sb3_vec_env(world, 2, render_mode="ansi")
    texts.reset(0)
    assert len(set(texts.env_method("render"))) == 1
    assert texts.get_images() == [None] * 6
    assert capsys.readouterr().out == ""
    told = sb3_vec_env(world, 1, render_mode="human")
    told.reset()
    assert "auv" in capsys.readouterr().out.lower()
    assert told.render() is None


@pytest.mark.parametrize(
    ("make", "name"),
    [(sb3_vec_env, "sb3_vec_env"), (supersuit_vec_env, "supersuit_vec_env")],
    ids=["sb3_vec_env", "supersuit_vec_env"],
)
def test_without_stable_baselines3_one_line_names_the_extra(monkeypatch, make, name):
    for module in list(sys.modules):
        if module.split(".")[0] == "stable_baselines3" or module.startswith(
            ("iout_marl.envs.s", "supersuit.vector.sb3")
        ):
            monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    with pytest.raises(InputError) as refused:
        make(scenario())
    assert str(refused.value) == (
        f"{name} needs stable_baselines3: pip install -e '.[sb3]' in the clone"
    )
