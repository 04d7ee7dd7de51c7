"""Environments of a sea that changes, in every API."""

import numpy as np
import pytest
import torch
from seas import OF_ANY, POLLED, ROUGH, TWO

from iout_marl import World, iout_v0, load_scenario, testing
from iout_marl.envs.joint import AUVEnv
from iout_marl.envs.sb3 import sb3_vec_env
from iout_marl.envs.vector import AUVVectorEnv
from iout_marl.tracing.unrolled import numbers, unrolled_slot

SHORT = {"episode.duration_s": 250}
TEAM = {**POLLED, **TWO, **SHORT}


@pytest.mark.slow
def test_the_parallel_environment_keeps_its_promises():
    testing.check_parallel_env(
        lambda: iout_v0.parallel_env("paper/k3-fdd", overrides=TEAM), seeds=(0, 7)
    )


def test_environments_that_begin_anew_are_as_fresh_ones():
    scenario = load_scenario("paper/k3-fdd", {**ROUGH, **SHORT})
    envs, alone = AUVVectorEnv(scenario, 2, autoreset_mode="Disabled"), AUVEnv(scenario)
    envs.reset(seed=0)
    envs.action_space.seed(0)
    for _ in range(3):
        envs.step(envs.action_space.sample())
    envs.reset(seed=[None, 11], options={"reset_mask": np.array([False, True])})
    alone.reset(seed=11)
    for _ in range(6):
        actions = envs.action_space.sample()
        seen, *_ = envs.step(actions)
        own, *_ = alone.step(actions[1])
        np.testing.assert_array_equal(seen[1], own)
    gains = envs.episodes.current.gain_db
    assert (gains[0] != gains[1]).all()


def test_stable_baselines_play_the_same_batch():
    pytest.importorskip("stable_baselines3")
    envs = sb3_vec_env("paper/k3-fdd", 3, overrides=TEAM)
    batch = AUVVectorEnv("paper/k3-fdd", 3, overrides=TEAM)
    envs.seed(5)
    envs.reset()
    batch.reset(seed=5)
    rng, auvs = np.random.default_rng(0), 2
    sizes = batch.episodes.world.action_sizes
    for _ in range(8):
        actions = np.stack([rng.integers(0, n, (3, auvs)) for n in sizes], axis=-1)
        seen, *_ = envs.step(actions.reshape(3 * auvs, -1))
        joint, *_ = batch.step(actions.reshape(3, -1))
        np.testing.assert_array_equal(seen.reshape(3, -1), joint)


@pytest.mark.parametrize("overrides", [ROUGH, TEAM], ids=["one", "two"])
def test_a_single_slot_is_traced_with_its_chance(overrides):
    scenario = load_scenario("paper/k3-fdd", overrides)
    slot, world = unrolled_slot(scenario), World(scenario)
    assert slot is not None
    state, chance, rng = world.reset(seed=2), world.draw_chance(2), np.random.default_rng(0)
    for _ in range(10):
        action = np.stack(
            [rng.integers(0, n, (1, world.num_auvs)) for n in world.action_sizes], axis=-1
        )
        drawn = next(chance)
        after, events = world.step(state, action, drawn)
        found, happened, *_ = slot(numbers(state), action.ravel().tolist(), numbers(drawn))
        for mine, theirs in zip(slot.state(found), after, strict=True):
            np.testing.assert_array_equal(mine, theirs)
        for mine, theirs in zip(slot.events(happened), events, strict=True):
            np.testing.assert_array_equal(mine, theirs)
        state = after


@pytest.mark.slow
def test_torch_compiles_a_slot_with_its_chance():
    world = World(load_scenario("best/k3-fdd", {**OF_ANY, **SHORT}), 2, torch)
    torch.compiler.reset()
    compiled = torch.compile(world.slot, fullgraph=True, backend="eager")
    state, chance = world.reset(seed=0), world.draw_chance(0)
    action = torch.zeros((2, world.num_auvs, 3), dtype=torch.int64)
    for _ in range(3):
        drawn = next(chance)
        expected, reward, seen = world.slot(state, action, drawn)
        found, own_reward, own_seen = compiled(state, action, drawn)
        assert torch.equal(seen, own_seen)
        assert torch.equal(reward, own_reward)
        assert torch.equal(found.gain_db, expected.gain_db)
        state = expected
