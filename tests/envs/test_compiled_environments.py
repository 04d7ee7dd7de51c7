"""Environments are played by compiled slots once it pays, and nobody sees a difference."""

import pickle

import numpy as np
import pytest

from iout_marl import iout_v0
from iout_marl.compiled import choice
from iout_marl.compiled.choice import SlotChoice
from iout_marl.compiled.slot import CompiledSlot
from iout_marl.envs import AUVVectorEnv
from iout_marl.envs.stepper import ArrayStepper, CompiledStepper, TracedStepper
from iout_marl.errors import InputError
from iout_marl.scenario import load_scenario
from iout_marl.tracing.library import UnknownOperationError

needs_llvm = pytest.mark.skipif(choice.find_spec("llvmlite") is None, reason="needs llvmlite")


@pytest.fixture
def when(monkeypatch):
    return lambda said: monkeypatch.setenv(choice.VARIABLE, said)


def played(env, slots=130):
    rng = np.random.default_rng(1)
    observation, infos = env.reset(seed=4)
    yield observation, infos
    for _ in range(slots):
        actions = [rng.integers(0, n, env.num_envs) for n in env.single_action_space.nvec]
        observation, reward, *ends, infos = env.step(np.stack(actions, axis=-1))
        yield observation, reward, *ends, infos


def assert_same(one, other):
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        one, other = one.values(), other.values()
    elif isinstance(one, np.ndarray) and one.dtype != object:
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)
        return
    elif not isinstance(one, list | tuple | type({}.values())):
        assert repr(one) == repr(other)
        return
    for mine, yours in zip(one, other, strict=True):
        assert_same(mine, yours)


@needs_llvm
@pytest.mark.slow
def test_one_environment_of_several_auvs_is_the_same_compiled(when):
    envs = []
    for said in ("never", "always"):
        when(said)
        envs.append(iout_v0.parallel_env("multi/m2-k10-fdd", overrides={"nodes.count": 3}))
    rng = np.random.default_rng(1)
    assert_same(*(env.reset(seed=4) for env in envs))
    while envs[0].agents:
        sizes = envs[0].action_space(envs[0].agents[0]).nvec
        actions = {agent: [rng.integers(n) for n in sizes] for agent in envs[0].agents}
        assert_same(*(env.step(actions) for env in envs))
    assert [type(env._episodes._stepper) for env in envs] == [TracedStepper, CompiledStepper]


@needs_llvm
@pytest.mark.slow
@pytest.mark.parametrize("mask", ["none", "info"])
def test_a_vector_environment_is_the_same_compiled(when, mask):
    envs = []
    for said in ("never", "always"):
        when(said)
        envs.append(AUVVectorEnv("paper/k3-fdd", 3, overrides={"observation.action_mask": mask}))
    for slots in zip(*map(played, envs), strict=True):
        assert_same(*slots)
    kinds = [type(env.episodes._stepper) for env in envs]
    assert kinds == [ArrayStepper, CompiledStepper]
    assert_same(*(tuple(env.episodes.current) for env in envs))
    assert_same(*(tuple(env.episodes.last_events) for env in envs))
    again = pickle.loads(pickle.dumps(envs[1]))
    assert_same(tuple(again.episodes.current), tuple(envs[0].episodes.current))


@needs_llvm
@pytest.mark.slow
def test_environments_restarted_one_by_one_are_the_same_compiled(when):
    found = []
    for said in ("never", "always"):
        when(said)
        env = AUVVectorEnv("paper/k3-fdd", 3, autoreset_mode="Disabled")
        rows = [*played(env, 20)]
        mask = np.array([False, True, False])
        rows.append(env.reset(options={"reset_mask": mask}))
        rows.append(env.step(np.zeros((3, 3), dtype=np.int64)))
        found.append(rows)
    assert_same(*found)


@needs_llvm
def test_numpy_plays_until_compiling_pays(monkeypatch, when):
    when("auto")
    compiled = []

    def compiles(slot):
        compiled.append(slot)

    monkeypatch.setattr(CompiledSlot, "compile", compiles)
    monkeypatch.setattr(CompiledSlot, "is_kept", False)
    monkeypatch.setattr(CompiledSlot, "seconds_to_compile", 2.0)
    slots = SlotChoice(load_scenario("paper/k3-fdd"))
    for seconds, number in ((0.05, 0), (0.5, 0), (1.9, 0), (2.1, 1), (20.0, 1)):
        slots.seconds = seconds
        assert (slots.slot() is not None) == bool(number)
        assert len(compiled) == number
    monkeypatch.setattr(CompiledSlot, "is_kept", True)
    slots = SlotChoice(load_scenario("paper/k3-fdd"))
    slots.seconds = 0.2
    assert slots.slot() is not None


@needs_llvm
def test_nothing_is_compiled_unasked_that_rounds_in_another_way(monkeypatch, when):
    when("auto")
    monkeypatch.setattr(CompiledSlot, "compile", lambda _: pytest.fail("compiled"))
    slots = SlotChoice(load_scenario("best/k3-tdd"))
    slots.seconds = 100.0
    assert slots.slot() is None
    assert not slots.waits


def test_never_is_never(when):
    when("never")
    slots = SlotChoice(load_scenario("paper/k3-fdd"))
    slots.seconds = 1e9
    assert slots.slot() is None


def test_a_word_that_says_nothing_is_refused(when):
    when("yes")
    with pytest.raises(InputError, match=r"IOUT_COMPILED must be one of auto, always, never"):
        AUVVectorEnv("paper/k3-fdd", 2)


def test_without_llvm_numpy_plays(monkeypatch, when):
    monkeypatch.setattr(choice, "find_spec", lambda _: None)
    when("auto")
    slots = SlotChoice(load_scenario("paper/k3-fdd"))
    slots.seconds = 1e9
    assert slots.slot() is None
    when("always")
    with pytest.warns(RuntimeWarning, match="llvmlite is not installed"):
        assert SlotChoice(load_scenario("paper/k3-fdd")).slot() is None


@needs_llvm
def test_what_has_no_compiled_form_is_left_to_numpy(monkeypatch, when):
    def fail(*_):
        raise UnknownOperationError("`cumulative_sum`")

    monkeypatch.setattr("iout_marl.compiled.slot.World.step", fail)
    when("always")
    slots = SlotChoice(load_scenario("paper/k3-fdd"))
    with pytest.warns(RuntimeWarning, match="no compiled form of `cumulative_sum`"):
        assert slots.slot() is None
    assert slots.slot() is None


@needs_llvm
def test_larger_teams_are_known_to_take_longer():
    seconds = [
        CompiledSlot(load_scenario("multi/m3-k10-fdd", {"auvs.count": auvs})).seconds_to_compile
        for auvs in (1, 2, 3)
    ]
    assert seconds == sorted(seconds)
    assert 0.1 < seconds[0] < seconds[2] / 2
