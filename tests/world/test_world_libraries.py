"""The same lines of the world on every array library, device and compiler."""

import os
import shutil
import sys

import array_api_strict
import numpy as np
import pytest
import torch

from iout_marl.scenario import load_scenario
from iout_marl.world import World, node_codes

pytestmark = pytest.mark.slow

WORLDS = {
    "fdd": ("paper/k3-fdd", {}),
    "tdd": ("paper/k3-tdd", {}),
    "stored-rule": ("best/k3-tdd", {}),
    "three-auvs": (
        "paper/k5-fdd",
        {
            "auvs.start_cells": [[5, 5, 2], [1, 1, 1], [9, 9, 4]],
            "observation": {"kind": "scaled", "node_positions": True, "time": True},
            "reward.unserved_penalty": 1.0,
            "reward.no_able_node_penalty": 1.0,
        },
    ),
    "disturbed-by-charging": (
        "best/k5-tdd",
        {"auvs.count": 3, "channel.access": "interference"},
    ),
    "limited-views-and-difference-rewards": (
        "best/k5-fdd",
        {
            "auvs.count": 3,
            "channel.access": "interference",
            "observation": {"kind": "scaled", "view_range_m": 400, "agent_index": True},
            "reward.credit": "difference",
        },
    ),
}


def make_world(case, num_envs, **backend):
    scenario = load_scenario(*WORLDS[case])
    world = World(scenario, num_envs, **backend)
    rngs = [np.random.default_rng(i) for i in range(num_envs)]
    return world, world.reset(node_codes(scenario, world.grid, rngs))


def random_actions(world, slots, seed=0):
    rng = np.random.default_rng(seed)
    shape = (slots, world.num_envs, world.num_auvs)
    return np.stack([rng.integers(0, n, shape) for n in world.action_sizes], axis=-1)


def everything(world, state, events):
    return {
        "state": world.observer.observe_globally(state),
        "observation": world.observe(state),
        "reward": world.reward(state, events),
        "mask": world.action_mask(state),
        "for the critic": _for_critic(world, state),
        **world.metrics(state),
    }


def _for_critic(world, state):
    return world.observer.observe_for_critic(state, central=True)


def as_numpy(array):
    return array.numpy() if isinstance(array, torch.Tensor) else np.asarray(array)


@pytest.mark.parametrize("library", [array_api_strict, torch], ids=["strict", "torch"])
@pytest.mark.parametrize("case", WORLDS)
def test_other_libraries_agree_with_numpy(case, library):
    reference, expected = make_world(case, 3)
    world, state = make_world(case, 3, library=library)
    for action in random_actions(world, 40):
        expected, expected_events = reference.step(expected, action)
        state, events = world.step(state, world.backend.integers(action))
        result = everything(world, state, events)
        for name, value in everything(reference, expected, expected_events).items():
            np.testing.assert_allclose(
                as_numpy(result[name]), value, rtol=1e-12, atol=1e-9, err_msg=name
            )


@pytest.mark.parametrize("library", [np, torch], ids=["numpy", "torch"])
@pytest.mark.parametrize("case", WORLDS)
def test_single_precision_stays_single(case, library):
    world, state = make_world(case, 2, library=library, dtype="float32")
    state, events = world.step(state, world.backend.integers(random_actions(world, 1)[0]))
    for name, value in everything(world, state, events).items():
        if name != "mask":
            assert value.dtype == library.float32, name
    assert state.energy_j.dtype == library.float32


# array_api_compat caches which library an array is of; the compiler looks through that.
LOOKS_THROUGH_A_CACHE = pytest.mark.filterwarnings(
    "ignore:Dynamo detected a call to a `functools.lru_cache`"
)


@LOOKS_THROUGH_A_CACHE
@pytest.mark.parametrize("case", WORLDS)
def test_a_slot_compiles_into_one_graph(case):
    world, state = make_world(case, 2, library=torch)
    torch.compiler.reset()
    compiled = torch.compile(world.slot, fullgraph=True, backend="eager")
    first, *actions = random_actions(world, 4)
    # A state of which no slot has been played lies in memory otherwise: a graph of its own.
    state, *_ = world.slot(state, torch.from_numpy(first))
    for action in actions:
        tensors = torch.from_numpy(action)
        expected = world.slot(state, tensors)
        result = compiled(state, tensors)
        assert torch.equal(result[0].energy_j, expected[0].energy_j)
        assert torch.equal(result[1], expected[1])
        assert torch.equal(result[2], expected[2])
        state = result[0]


CXX = os.environ.get("CXX", "clang++" if sys.platform == "darwin" else "g++")


@LOOKS_THROUGH_A_CACHE
@pytest.mark.filterwarnings("ignore:`torch.jit.script_method` is deprecated:DeprecationWarning")
@pytest.mark.skipif(shutil.which(CXX) is None, reason=f"no C++ compiler {CXX}")
@pytest.mark.parametrize(
    # One is compiled to C++, which takes long; of others the graph is played.
    ("case", "compiler"),
    [("fdd", "eager"), ("stored-rule", "eager"), ("three-auvs", "inductor")],
)
def test_a_compiled_world_does_what_numpy_does_over_an_episode(case, compiler):
    reference, expected = make_world(case, 3)
    world, state = make_world(case, 3, library=torch)
    torch.compiler.reset()
    slot = torch.compile(world.slot, fullgraph=True, backend=compiler)
    for action in random_actions(world, world.num_slots):
        expected, *expected_results = reference.slot(expected, action)
        state, *results = slot(state, torch.from_numpy(action))
        for name, value in expected._asdict().items():
            np.testing.assert_allclose(
                getattr(state, name), value, rtol=1e-9, atol=1e-9, err_msg=name
            )
        for result, value in zip(results, expected_results, strict=True):
            np.testing.assert_allclose(result, value, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("library", [np, array_api_strict, torch], ids=["numpy", "strict", "torch"])
@pytest.mark.parametrize("case", WORLDS)
def test_states_in_any_memory_order_lead_to_the_same(case, library):
    world, state = make_world(case, 3, library=library)
    other = state
    for numbers in random_actions(world, 20):
        action = world.backend.integers(numbers)
        state, reward, observation = world.slot(state, action)
        rows_inside = other.map(lambda a: library.asarray(np.array(as_numpy(a), order="C")))
        other, other_reward, other_observation = world.slot(rows_inside, action)
        for name, value in state._asdict().items():
            np.testing.assert_array_equal(
                as_numpy(getattr(other, name)), as_numpy(value), err_msg=name
            )
        np.testing.assert_array_equal(as_numpy(other_reward), as_numpy(reward))
        np.testing.assert_array_equal(as_numpy(other_observation), as_numpy(observation))
