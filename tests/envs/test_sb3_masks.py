"""Action masks as sb3-contrib's MaskablePPO asks for them, by every way to Stable-Baselines3."""

import itertools

import gymnasium
import numpy as np
import pytest
from env_cases import SLOTS, STARTS, scenario
from sb3_contrib import MaskablePPO
from sb3_contrib.common.maskable.evaluation import evaluate_policy
from sb3_contrib.common.maskable.utils import get_action_masks, is_masking_supported
from stable_baselines3.common.vec_env import DummyVecEnv, VecFrameStack, VecNormalize
from vec_env_cases import PLAYED

from iout_marl import InputError, iout_v0, load_scenario
from iout_marl.envs import AUVEnv, sb3_vec_env, supersuit_vec_env

WORLDS, SEED = 2, 3
MASKS = ("none", "info", "observation")
#: So little power that some nodes are beyond reach: masks have zeros in them.
TIGHT = {"charging.power_w": 2000}
TINY = {"n_steps": SLOTS, "batch_size": 2 * SLOTS, "n_epochs": 2, "seed": 0}

# Newer versions of Python warn of any fork beside threads, which SuperSuit's workers are.
pytestmark = pytest.mark.filterwarnings(
    "ignore:This process .* is multi-threaded:DeprecationWarning"
)


def allowed_actions(env, masks, rng):
    """A random action for each row of masks, drawn among what they allow."""
    sizes = env.action_space.nvec
    return np.array(
        [
            [rng.choice(np.flatnonzero(part)) for part in np.split(row, np.cumsum(sizes)[:-1])]
            for row in masks
        ]
    )


def in_processes(world, num_envs):
    return supersuit_vec_env(world, num_envs, processes=2)


#: By name: what makes the VecEnv, and where the scenario must hand out masks.
ROUTES = {
    "batched-none": (sb3_vec_env, "none"),
    "batched-info": (sb3_vec_env, "info"),
    "batched-observation": (sb3_vec_env, "observation"),
    "supersuit-info": (supersuit_vec_env, "info"),
    "supersuit-observation": (supersuit_vec_env, "observation"),
    "processes-info": (in_processes, "info"),
    "processes-observation": (in_processes, "observation"),
}
#: Worker processes take their time; what they play does not depend on the scenario.
PLAYED_BY = [
    (route, duplex, auvs)
    for route, duplex, auvs in itertools.product(ROUTES, ("fdd", "tdd"), STARTS)
    if not route.startswith("processes") or (duplex, auvs) == ("fdd", 3)
]


@pytest.mark.slow
@pytest.mark.parametrize(("route", "duplex", "auvs"), PLAYED_BY)
def test_masks_of_every_slot_are_those_of_the_parallel_environment(route, duplex, auvs):
    make, place = ROUTES[route]
    vec_env = make(scenario(duplex, auvs, "episode", place, **TIGHT), WORLDS)
    told = scenario(duplex, auvs, "episode", "info", **TIGHT)
    singles = [iout_v0.parallel_env(told) for _ in range(WORLDS)]
    names = singles[0].possible_agents
    rng = np.random.default_rng(0)
    assert is_masking_supported(vec_env)
    vec_env.seed(SEED)
    vec_env.reset()
    infos = [single.reset(seed=SEED + i)[1] for i, single in enumerate(singles)]
    hidden = 0
    for _ in range(PLAYED):
        masks = get_action_masks(vec_env)
        expected = [info[name]["action_mask"] for info in infos for name in names]
        assert masks.dtype == np.bool_
        np.testing.assert_array_equal(masks, expected)
        np.testing.assert_array_equal(vec_env.action_masks(), masks)
        np.testing.assert_array_equal(vec_env.env_method("action_masks", indices=[-1]), masks[-1:])
        np.testing.assert_array_equal(vec_env.get_attr("action_masks", 0)[0](), masks[0])
        hidden += (~masks).sum()
        actions = allowed_actions(vec_env, masks, rng)
        vec_env.step(actions)
        by_env = actions.reshape(WORLDS, len(names), -1)
        infos = [
            single.step(dict(zip(names, own, strict=True)))[-1]
            for single, own in zip(singles, by_env, strict=True)
        ]
        if not singles[0].agents:
            infos = [single.reset()[1] for single in singles]
    assert hidden
    vec_env.close()


@pytest.mark.parametrize("mask", MASKS)
@pytest.mark.parametrize("duplex", ["fdd", "tdd"])
@pytest.mark.parametrize("auvs", STARTS)
def test_masks_of_the_joint_environment_are_those_of_all_auvs(auvs, duplex, mask):
    env = AUVEnv(scenario(duplex, auvs, "episode", mask, **TIGHT))
    single = iout_v0.parallel_env(scenario(duplex, auvs, "episode", "info", **TIGHT))
    rng = np.random.default_rng(0)
    env.reset(seed=SEED)
    _, infos = single.reset(seed=SEED)
    assert is_masking_supported(env)
    for _ in range(SLOTS):
        masks = get_action_masks(env)
        expected = np.concatenate([info["action_mask"] for info in infos.values()])
        assert masks.dtype == np.bool_
        assert masks.shape == (env.action_space.nvec.sum(),)
        np.testing.assert_array_equal(masks, expected)
        action = allowed_actions(env, masks[None], rng)[0]
        env.step(action)
        own = action.reshape(auvs, -1)
        *_, infos = single.step(dict(zip(single.possible_agents, own, strict=True)))


def test_masks_come_through_wrappers():
    world = scenario(auvs=3)
    made = gymnasium.make("iout_marl:AUV-v0", scenario=world)
    made.reset(seed=0)
    assert is_masking_supported(made)
    expected = get_action_masks(made)
    dummy = DummyVecEnv([lambda: gymnasium.make("iout_marl:AUV-v0", scenario=world)])
    dummy.seed(0)
    dummy.reset()
    assert is_masking_supported(dummy)
    np.testing.assert_array_equal(get_action_masks(dummy)[0], expected)
    for wrap in (VecNormalize, lambda env: VecFrameStack(env, n_stack=2)):
        for make in (sb3_vec_env, supersuit_vec_env):
            masked = load_scenario(world, {"observation.action_mask": "info"})
            wrapped = wrap(make(masked, 1))
            wrapped.seed(0)
            wrapped.reset()
            assert is_masking_supported(wrapped)
            np.testing.assert_array_equal(np.concatenate(get_action_masks(wrapped)), expected)
            wrapped.close()


@pytest.mark.slow
@pytest.mark.parametrize("processes", [0, 2])
def test_supersuit_without_masks_has_none_and_says_what_to_do(processes):
    vec_env = supersuit_vec_env(scenario(), WORLDS, processes)
    vec_env.reset()
    assert not is_masking_supported(vec_env)
    with pytest.raises(InputError, match=r"^observation.action_mask: is none, .* sb3_vec_env"):
        vec_env.env_method("action_masks")
    vec_env.close()


@pytest.mark.parametrize("make", [AUVEnv, sb3_vec_env, supersuit_vec_env])
def test_before_the_first_reset_there_are_no_masks(make):
    with pytest.raises(RuntimeError, match=r"call reset\(\) first"):
        make(scenario(mask="info")).action_masks()


def policy_for(world):
    in_observation = world.observation.action_mask == "observation"
    return "MultiInputPolicy" if in_observation else "MlpPolicy"


def hidden_choices(told):
    """How many of the actions of a step of a rollout were masked."""
    masks, actions = told["action_masks"], told["actions"].astype(int)
    sizes = told["env"].action_space.nvec
    first = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    return int((~np.take_along_axis(masks, actions + first, axis=1)).sum())


@pytest.mark.slow
@pytest.mark.parametrize("mask", MASKS)
@pytest.mark.parametrize("auvs", STARTS)
def test_maskable_ppo_trains_on_the_batched_world(auvs, mask):
    world = scenario(auvs=auvs, mask=mask, **TIGHT)
    model = MaskablePPO(policy_for(world), sb3_vec_env(world, WORLDS), **TINY)
    before = [parameter.clone() for parameter in model.policy.parameters()]
    hidden = []

    def look(told, _):
        hidden.append(hidden_choices(told))
        return True

    model.learn(2 * SLOTS * WORLDS * auvs, look)
    assert hidden == [0] * (2 * SLOTS)
    assert (model.rollout_buffer.action_masks == 0).any()
    assert any((a != b).any() for a, b in zip(before, model.policy.parameters(), strict=True))
    assert len(model.ep_info_buffer) == 2 * WORLDS * auvs
    returns, lengths = evaluate_policy(
        model, sb3_vec_env(world, WORLDS), 4, return_episode_rewards=True
    )
    assert lengths == [SLOTS] * 4
    assert np.isfinite(returns).all()


@pytest.mark.slow
def test_maskable_ppo_may_always_name_nobody():
    """Even where it hears nobody in earnest: no node can pay."""
    poor = {"charging.power_w": 1e-3, "auvs.idle_choices": True}
    world = scenario(auvs=3, mask="info", **poor)
    model = MaskablePPO(policy_for(world), sb3_vec_env(world, WORLDS), **TINY)
    model.learn(2 * SLOTS * WORLDS * 3)
    masks = model.rollout_buffer.action_masks.reshape(-1, 6 + 4 + 4)
    assert masks[:, 9].all()
    assert masks[:, 13].all()
    assert not masks[:, 10:13].any()
    assert (model.rollout_buffer.actions.reshape(-1, 3)[:, 2] == 3).all()


@pytest.mark.slow
@pytest.mark.parametrize("processes", [0, 2])
@pytest.mark.parametrize("mask", ["info", "observation"])
def test_maskable_ppo_trains_on_both_routes_alike(mask, processes):
    world = scenario(auvs=3, mask=mask, **TIGHT)
    routes = [sb3_vec_env(world, WORLDS), supersuit_vec_env(world, WORLDS, processes)]
    ours, theirs = (
        [*MaskablePPO(policy_for(world), each, **TINY).learn(120).policy.parameters()]
        for each in routes
    )
    for a, b in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(a.detach(), b.detach(), rtol=1e-4, atol=1e-5)
    routes[1].close()


@pytest.mark.slow
@pytest.mark.parametrize("mask", MASKS)
def test_maskable_ppo_trains_on_the_joint_environment_without_a_wrapper(mask):
    world = scenario(auvs=3, mask=mask, **TIGHT)
    model = MaskablePPO(policy_for(world), AUVEnv(world), **TINY)
    model.learn(2 * SLOTS)
    assert (model.rollout_buffer.action_masks == 0).any()
    assert model.rollout_buffer.action_masks.shape[-1] == 3 * (6 + 3 + 3)
