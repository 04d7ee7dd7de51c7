"""Checks of multi-agent and batched environments that the usual suites leave out.

PettingZoo's own tests let wrong dtypes, observations outside their space, NaN rewards
and non-determinism after the first step pass. `check_parallel_env` runs whole episodes
and raises `AssertionError` with what it found:

    from iout_marl import iout_v0
    from iout_marl.testing import check_parallel_env
    check_parallel_env(lambda: iout_v0.parallel_env("paper/k3-fdd"))

`check_vector_env` compares a batched environment with single ones, number for number.
"""

from __future__ import annotations

import contextlib
import copy
import math
import pickle
import random
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeAlias

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, SyncVectorEnv

#: Makes a new environment.
EnvFactory: TypeAlias = Callable[[], Any]
#: Everything that an episode handed out, slot by slot.
Record: TypeAlias = list[Any]

SEEDS = (0, 1, 12345)
#: An episode that is longer is taken to have no end.
MAX_SLOTS = 10_000


def check_parallel_env(make: EnvFactory, seeds: tuple[int, ...] = SEEDS) -> None:
    """Run every check of a PettingZoo ParallelEnv.

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
    twin = copy.deepcopy(space)
    twin.seed(int(rng.integers(2**31)))
    return twin.sample()


def _slots(env: Any, rng: np.random.Generator) -> Iterator[Any]:
    """What each `step` returns under random actions, up to the end of the episode."""
    for _ in range(MAX_SLOTS):
        if not env.agents:
            return
        yield env.step(sample_actions(env, rng))
    raise AssertionError(f"the episode has no end within {MAX_SLOTS} slots")


def _snapshot(env: Any, returned: Any) -> Any:
    """A deep copy of what was returned, and of the state where there is one."""
    state = env.state() if hasattr(env, "state_space") else None
    return copy.deepcopy((returned, state))


def play(env: Any, seed: int) -> Record:
    """Reset by the seed and play an episode of random actions; returns copies of all handed out."""
    return [_snapshot(env, env.reset(seed=seed)), *play_on(env, seed)]


def play_on(env: Any, seed: int) -> Record:
    """Play a running episode to its end, and one more without a seed, by random actions."""
    rng = np.random.default_rng(seed)
    record = [_snapshot(env, returned) for returned in _slots(env, rng)]
    record.append(_snapshot(env, env.reset()))
    return record + [_snapshot(env, returned) for returned in _slots(env, rng)]


def check_contained(make: EnvFactory, seed: int) -> None:
    """Every observation lies in its space with its exact dtype, every number is finite.

    Also: agents never leave in mid-episode and end together, flags are Python bools and
    rewards Python floats, infos have the same numeric keys from `reset` on, and `state()`
    lies in its space.
    """
    env, rng = make(), np.random.default_rng(seed)
    observations, infos = env.reset(seed=seed)
    agents = list(env.agents)
    assert agents, "no agent is alive after a reset"
    keys = {agent: set(infos[agent]) for agent in agents}
    _check_slot(env, agents, observations, infos, keys)
    for observations, rewards, terminations, truncations, infos in _slots(env, rng):
        _check_slot(env, agents, observations, infos, keys)
        for what in (rewards, terminations, truncations):
            assert list(what) == agents, f"the agents are {agents}, but got {list(what)}"
        for agent in agents:
            assert type(rewards[agent]) is float, f"reward is a {type(rewards[agent])}"
            assert math.isfinite(rewards[agent]), f"reward is {rewards[agent]}"
            assert type(terminations[agent]) is bool, "a termination is not a bool"
            assert type(truncations[agent]) is bool, "a truncation is not a bool"
        ends = {terminations[a] or truncations[a] for a in agents}
        assert len(ends) == 1, "agents end in different slots"
        assert ends == {not env.agents}, "agents are alive after their end, or dead before it"
        assert env.agents in ([], agents), "an agent left in mid-episode"


def _check_slot(
    env: Any,
    agents: list[str],
    observations: Mapping[str, Any],
    infos: Mapping[str, Mapping[str, Any]],
    keys: Mapping[str, set[str]],
) -> None:
    assert list(observations) == agents, f"observations are of {list(observations)}"
    assert list(infos) == agents, f"infos are of {list(infos)}"
    for agent in agents:
        _check_in_space(env.observation_space(agent), observations[agent], agent)
        assert set(infos[agent]) == keys[agent], f"the keys of {agent}'s info change"
        for name, value in infos[agent].items():
            array = np.asarray(value)
            assert array.dtype.kind in "biuf", f"info {name} is not a number: {value!r}"
            assert np.isfinite(array).all(), f"info {name} is {value}"
    if hasattr(env, "state_space"):
        _check_in_space(env.state_space, env.state(), "state")


def _check_in_space(space: spaces.Space[Any], value: Any, what: str) -> None:
    if isinstance(space, spaces.Dict):
        assert isinstance(value, dict), f"{what} is a {type(value)}"
        assert value.keys() == space.spaces.keys(), f"{what} has the keys {list(value)}"
        for key, subspace in space.spaces.items():
            _check_in_space(subspace, value[key], f"{what}[{key}]")
        return
    if isinstance(space, spaces.Tuple):
        assert isinstance(value, tuple), f"{what} is a {type(value)}"
        assert len(value) == len(space.spaces), f"{what} has {len(value)} parts"
        for i, subspace in enumerate(space.spaces):
            _check_in_space(subspace, value[i], f"{what}[{i}]")
        return
    dtype = getattr(value, "dtype", space.dtype)
    assert dtype == space.dtype, f"{what} is {dtype}, its space {space.dtype}"
    assert space.contains(value), f"{what} lies outside its space: {value}"


def check_deterministic(make: EnvFactory, seed: int) -> None:
    """Two environments with equal seeds agree over a whole episode, and over the next."""
    message = "two environments with equal seeds differ"
    assert_equal(play(make(), seed), play(make(), seed), message)


def check_reset_repeats(make: EnvFactory, seed: int) -> None:
    """A second reset with the same seed repeats the first, in mid-episode too.

    Also, one with another seed starts as a new environment does.
    """
    env = make()
    first = play(env, seed)
    assert_equal(first, play(env, seed), "a second reset with the same seed differs")
    message = "a reset with another seed leaves something behind"
    assert_equal(play(make(), seed + 1), play(env, seed + 1), message)
    assert_equal(first, play(env, seed), message)
    env.reset(seed=seed)
    env.step(sample_actions(env, np.random.default_rng(seed)))
    assert_equal(first, play(env, seed), "a reset in mid-episode leaves something behind")


def check_nothing_is_mutated(make: EnvFactory, seed: int) -> None:
    """What was handed out is never changed later, and writing into it changes nothing."""
    env, rng = make(), np.random.default_rng(seed)
    handed_out: Record = []

    def keep(returned: Any) -> Any:
        handed_out.append((returned, env.state() if hasattr(env, "state_space") else None))
        return copy.deepcopy(handed_out[-1])

    copies = [keep(env.reset(seed=seed))]
    copies += [keep(returned) for returned in _slots(env, rng)]
    env.reset()
    assert_equal(handed_out, copies, "something handed out was changed later")

    message = "writing into what was handed out changes the environment"
    with _blamed(message):
        assert_equal(_play_spoiling(make(), seed), copies, message)


def _play_spoiling(env: Any, seed: int) -> Record:
    """Play an episode, and write into whatever is handed out and in."""
    rng = np.random.default_rng(seed)
    returned = env.reset(seed=seed)
    record = [_snapshot(env, returned)]
    while env.agents:
        _spoil(returned)
        if hasattr(env, "state_space"):
            _spoil(env.state())
        actions = sample_actions(env, rng)
        returned = env.step(actions)
        _spoil(actions)
        record.append(_snapshot(env, returned))
    return record


@contextlib.contextmanager
def _blamed(message: str) -> Iterator[None]:
    """Whatever the environment raises is an AssertionError with this message."""
    try:
        yield
    except AssertionError:
        raise
    except Exception as error:
        raise AssertionError(f"{message}: {error!r}") from error


def _spoil(value: Any) -> None:
    """Change every number of a nested record, and empty its dictionaries."""
    if isinstance(value, np.ndarray) and value.dtype != object:
        if value.flags.writeable:
            value[...] = value == 0
        return
    if isinstance(value, dict):
        for part in value.values():
            _spoil(part)
        value.clear()
    elif isinstance(value, list | tuple | np.ndarray):
        for part in value:
            _spoil(part)


def check_copies_continue(make: EnvFactory, seed: int) -> None:
    """A deep copy and a pickle, taken in mid-episode, continue as the original does."""
    env, rng = make(), np.random.default_rng(seed)
    env.reset(seed=seed)
    for _ in zip(range(3), _slots(env, rng), strict=False):
        pass
    with _blamed("the environment cannot be copied"):
        copies = {"deep copy": copy.deepcopy(env), "pickle": pickle.loads(pickle.dumps(env))}
    original = play_on(env, seed + 1)
    for what, twin in copies.items():
        message = f"a {what} continues differently"
        with _blamed(message):
            assert_equal(original, play_on(twin, seed + 1), message)


def check_global_generators_untouched(make: EnvFactory, seed: int) -> None:
    """Neither Python's nor NumPy's global generator is drawn from or seeded."""
    before = random.getstate(), np.random.get_state(legacy=False)  # noqa: NPY002
    try:
        # Whoever seeded them just now would seed them to where they are.
        random.random()
        np.random.random()  # noqa: NPY002
        python, numpy = random.getstate(), np.random.get_state(legacy=False)  # noqa: NPY002
        make().reset()
        play(make(), seed)
        assert random.getstate() == python, "Python's global generator was touched"
        after = np.random.get_state(legacy=False)  # noqa: NPY002
        assert_equal(numpy, after, "NumPy's global generator was touched")
    finally:
        random.setstate(before[0])
        np.random.set_state(before[1])  # noqa: NPY002


def check_vector_env(
    make_vector: EnvFactory,
    make_single: EnvFactory,
    seeds: tuple[int, ...] = SEEDS,
    autoreset_mode: AutoresetMode = AutoresetMode.SAME_STEP,
) -> None:
    """A batched environment does what Gymnasium's SyncVectorEnv does with single ones.

    Over two episodes and what is between them: spaces, observations, flags, infos and
    `final_obs` are equal bit for bit, rewards up to rounding (a sum in a batch may round
    otherwise), and writing into what the batched one handed out changes nothing. Where resets
    are left to the caller, single environments are also reset in mid-episode.

    Args:
        make_vector: makes a `gymnasium.vector.VectorEnv`.
        make_single: makes the `gymnasium.Env` that it has in batch.
        seeds: seeds to check with.
        autoreset_mode: the mode in which it must be.

    Raises:
        AssertionError: what is wrong.
    """
    for seed in seeds:
        vector = make_vector()
        mode = vector.metadata["autoreset_mode"]
        assert mode == autoreset_mode, f"the autoreset mode is {mode}, not {autoreset_mode}"
        single = SyncVectorEnv([make_single] * vector.num_envs, autoreset_mode=mode)
        for name in ("single_observation_space", "single_action_space"):
            assert getattr(vector, name) == getattr(single, name), f"{name} differs"
        message = "the batched environment differs from single ones"
        returned = vector.reset(seed=seed)
        assert_equal(returned, single.reset(seed=seed), message)
        rng, ended = np.random.default_rng(seed), np.zeros(vector.num_envs, dtype=int)
        for slot in range(MAX_SLOTS):
            _spoil(returned)
            actions = _sample(vector.action_space, rng)
            returned, expected = vector.step(actions), single.step(actions)
            for i, name in enumerate(("observations", "rewards", "ends", "truncations", "infos")):
                equal = _assert_close if name == "rewards" else assert_equal
                equal(returned[i], expected[i], f"{message} in their {name}")
            over = expected[2] | expected[3]
            ended += over
            if (ended >= 2).all():
                break
            if mode == AutoresetMode.DISABLED:
                if slot == 1:
                    over[0] = True
                if over.any():
                    # Gymnasium takes the mask out of the options.
                    options = ({"reset_mask": over.copy()} for _ in range(2))
                    returned = vector.reset(options=next(options))
                    again = single.reset(options=next(options))
                    assert_equal(returned, again, f"{message} after a reset of some")
        else:
            raise AssertionError(f"the episodes have no end within {MAX_SLOTS} slots")


def _assert_close(first: Any, second: Any, message: str) -> None:
    assert first.dtype == second.dtype, f"{message} (dtype)"
    assert first.shape == second.shape, f"{message} (shape)"
    close = np.allclose(first, second, rtol=1e-12, atol=1e-12)
    assert close, f"{message}: {first} is not {second}"


def assert_equal(first: Any, second: Any, message: str) -> None:
    """Raise AssertionError unless two nested records are equal bit for bit."""
    if isinstance(first, Mapping):
        assert isinstance(second, Mapping), message
        assert first.keys() == second.keys(), f"{message} (keys)"
        for key in first:
            assert_equal(first[key], second[key], f"{message} [{key}]")
    elif isinstance(first, np.ndarray) and first.dtype != object:
        assert isinstance(second, np.ndarray), message
        assert first.dtype == second.dtype, f"{message} (dtype)"
        same = np.array_equal(first, second, equal_nan=True)
        assert same, f"{message}: {first} is not {second}"
    elif isinstance(first, list | tuple | np.ndarray):
        assert len(first) == len(second), message
        for i, (a, b) in enumerate(zip(first, second, strict=True)):
            assert_equal(a, b, f"{message} [{i}]")
    else:
        assert type(first) is type(second), message
        assert first == second, f"{message}: {first} is not {second}"
