"""Checks of a PettingZoo ParallelEnv that the usual suites leave out.

PettingZoo's own tests let wrong dtypes, observations outside their space, NaN rewards
and non-determinism after the first step pass. `check_parallel_env` runs whole episodes
and raises `AssertionError` with what it found:

    from iout_marl import iout_v0
    from iout_marl.testing import check_parallel_env
    check_parallel_env(lambda: iout_v0.parallel_env("paper/k3-fdd"))
"""

from __future__ import annotations

import copy
import math
import pickle
import random
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np
from gymnasium import spaces

#: Makes a new environment.
EnvFactory: TypeAlias = Callable[[], Any]
#: Everything that an episode handed out, slot by slot.
Record: TypeAlias = list[Any]

SEEDS = (0, 1, 12345)


def check_parallel_env(make: EnvFactory, seeds: tuple[int, ...] = SEEDS) -> None:
    """Run every check of this module.

    Args:
        make: makes a new environment.
        seeds: seeds to check with; 0 belongs among them, since it is easily mistaken
            for no seed.

    Raises:
        AssertionError: what is wrong.
    """
    for seed in seeds:
        check_contained(make, seed)
        check_deterministic(make, seed)
        check_reset_repeats(make, seed)
        check_nothing_is_mutated(make, seed)
        check_copies_continue(make, seed)
        check_global_generators_untouched(make, seed)


def sample_actions(env: Any, rng: np.random.Generator) -> dict[str, Any]:
    """A random action for every living agent, from `rng` and not from the spaces' streams."""
    return {agent: _sample(env.action_space(agent), rng) for agent in env.agents}


def _sample(space: spaces.Space[Any], rng: np.random.Generator) -> Any:
    if isinstance(space, spaces.MultiDiscrete):
        return rng.integers(0, space.nvec).astype(space.dtype)
    if isinstance(space, spaces.Discrete):
        return int(space.start + rng.integers(0, space.n))
    assert isinstance(space, spaces.Box), f"no sampler for {space}"
    return rng.uniform(space.low, space.high).astype(space.dtype)


def play(env: Any, seed: int, *, reset: bool = True) -> Record:
    """Play one episode of random actions to its end; returns deep copies of all handed out."""
    rng = np.random.default_rng(seed)
    record: Record = []
    if reset:
        record.append(copy.deepcopy(env.reset(seed=seed)))
    while env.agents:
        record.append(copy.deepcopy(env.step(sample_actions(env, rng))))
    return record


def check_contained(make: EnvFactory, seed: int) -> None:
    """Every observation lies in its space with its exact dtype, every number is finite.

    Also: agents never leave in mid-episode and end together, flags are Python bools and
    rewards Python floats, infos have the same numeric keys from `reset` on, and `state()`
    lies in its space.
    """
    env, rng = make(), np.random.default_rng(seed)
    observations, infos = env.reset(seed=seed)
    agents = list(env.agents)
    keys = {agent: set(infos[agent]) for agent in agents}
    _check_slot(env, agents, observations, infos, keys)
    while env.agents:
        assert env.agents == agents, "an agent left in mid-episode"
        observations, rewards, terminations, truncations, infos = env.step(sample_actions(env, rng))
        _check_slot(env, agents, observations, infos, keys)
        for agent in agents:
            assert type(rewards[agent]) is float, f"reward is a {type(rewards[agent])}"
            assert math.isfinite(rewards[agent]), f"reward is {rewards[agent]}"
            assert type(terminations[agent]) is bool, "a termination is not a bool"
            assert type(truncations[agent]) is bool, "a truncation is not a bool"
        ends = {terminations[a] or truncations[a] for a in agents}
        assert len(ends) == 1, "agents end in different slots"
        assert ends == {not env.agents}, "agents are alive after their end, or dead before it"


def _check_slot(
    env: Any,
    agents: list[str],
    observations: Mapping[str, Any],
    infos: Mapping[str, Mapping[str, Any]],
    keys: Mapping[str, set[str]],
) -> None:
    assert list(observations) == agents, "an agent has no observation"
    for agent in agents:
        _check_in_space(env.observation_space(agent), observations[agent], agent)
        assert set(infos[agent]) == keys[agent], f"the keys of {agent}'s info change"
        for name, value in infos[agent].items():
            assert np.isfinite(np.asarray(value, dtype=float)).all(), f"info {name} is {value}"
    if hasattr(env, "state_space"):
        _check_in_space(env.state_space, env.state(), "state")


def _check_in_space(space: spaces.Space[Any], value: Any, what: str) -> None:
    if isinstance(space, spaces.Dict):
        assert list(value) == list(space.spaces), f"{what} has the keys {list(value)}"
        for key, subspace in space.spaces.items():
            _check_in_space(subspace, value[key], f"{what}[{key}]")
        return
    assert value.dtype == space.dtype, f"{what} is {value.dtype}, its space {space.dtype}"
    assert space.contains(value), f"{what} lies outside its space: {value}"


def check_deterministic(make: EnvFactory, seed: int) -> None:
    """Two environments with equal seeds agree over a whole episode, and into the next."""
    first, second = make(), make()
    assert_equal(play(first, seed), play(second, seed), "two environments with equal seeds differ")
    first.reset()
    second.reset()
    assert_equal(
        play(first, seed, reset=False),
        play(second, seed, reset=False),
        "two environments with equal seeds differ in their second episode",
    )


def check_reset_repeats(make: EnvFactory, seed: int) -> None:
    """A second reset with the same seed repeats the first, in mid-episode too."""
    env = make()
    first = play(env, seed)
    assert_equal(first, play(env, seed), "a second reset with the same seed differs")
    env.reset(seed=seed)
    env.step(sample_actions(env, np.random.default_rng(seed)))
    assert_equal(first, play(env, seed), "a reset in mid-episode leaves something behind")


def check_nothing_is_mutated(make: EnvFactory, seed: int) -> None:
    """What was handed out is never changed later, and writing into it changes nothing."""
    env, rng = make(), np.random.default_rng(seed)
    handed_out = [env.reset(seed=seed)]
    copies = [copy.deepcopy(handed_out[0])]
    while env.agents:
        handed_out.append(env.step(sample_actions(env, rng)))
        copies.append(copy.deepcopy(handed_out[-1]))
    assert_equal(handed_out, copies, "something handed out was changed later")

    spoilt, rng = make(), np.random.default_rng(seed)
    record = [copy.deepcopy(returned := spoilt.reset(seed=seed))]
    _spoil(returned)
    while spoilt.agents:
        actions = sample_actions(spoilt, rng)
        record.append(copy.deepcopy(returned := spoilt.step(actions)))
        _spoil(returned)
        _spoil((actions,))
    assert_equal(record, copies, "writing into what was handed out changes the environment")


def _spoil(returned: tuple[dict[str, Any], ...]) -> None:
    for mapping in returned:
        for value in mapping.values():
            for array in value.values() if isinstance(value, dict) else [value]:
                if isinstance(array, np.ndarray):
                    array[...] = 0
        mapping.clear()


def check_copies_continue(make: EnvFactory, seed: int) -> None:
    """A deep copy and a pickle, taken in mid-episode, go on as the original does."""
    env, rng = make(), np.random.default_rng(seed)
    env.reset(seed=seed)
    for _ in range(3):
        env.step(sample_actions(env, rng))
    copies = {"deep copy": copy.deepcopy(env), "pickle": pickle.loads(pickle.dumps(env))}
    original = play(env, seed + 1, reset=False)
    env.reset()
    original += play(env, seed + 2, reset=False)
    for what, twin in copies.items():
        record = play(twin, seed + 1, reset=False)
        twin.reset()
        record += play(twin, seed + 2, reset=False)
        assert_equal(original, record, f"a {what} goes on differently")


def check_global_generators_untouched(make: EnvFactory, seed: int) -> None:
    """Neither Python's nor NumPy's global generator is drawn from or seeded."""
    python, numpy = random.getstate(), np.random.get_state(legacy=False)  # noqa: NPY002
    play(make(), seed)
    assert random.getstate() == python, "Python's global generator was touched"
    after = np.random.get_state(legacy=False)  # noqa: NPY002
    assert_equal(numpy, after, "NumPy's global generator was touched")


def assert_equal(first: Any, second: Any, message: str) -> None:
    """Raise AssertionError unless two nested records are equal bit for bit."""
    if isinstance(first, Mapping):
        assert isinstance(second, Mapping), message
        assert list(first) == list(second), message
        for key in first:
            assert_equal(first[key], second[key], f"{message} ({key})")
    elif isinstance(first, list | tuple):
        assert len(first) == len(second), message
        for a, b in zip(first, second, strict=True):
            assert_equal(a, b, message)
    elif isinstance(first, np.ndarray):
        assert first.dtype == second.dtype, message
        assert np.array_equal(first, second, equal_nan=True), message
    else:
        assert type(first) is type(second), message
        assert first == second, message
