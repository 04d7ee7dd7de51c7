"""A single environment with what the tracer cannot follow plays on arrays, and says so once."""

import warnings

import numpy as np
import pytest

from iout_marl import InputError, iout_v0, load_scenario, metrics, parts
from iout_marl.tracing.unrolled import unrolled_slot


@pytest.fixture
def registered():
    """Registers a reward for the time of a test."""
    kinds = []

    def register(function, kind="mine"):
        class Mine(parts.Reward):
            def __call__(self, state, events):
                return {"mine": function(self.xp, state)}

        parts.rewards.register(kind, version=1)(Mine)
        kinds.append(kind)
        return load_scenario("paper/k3-fdd", {"reward": {"kind": kind}})

    yield register
    for kind in kinds:
        parts.rewards.unregister(kind)


def rewards_of(env, slots=20):
    """An episode's rewards by actions of one seed."""
    env.reset(seed=0)
    env.action_space("auv_0").seed(0)
    found = []
    for _ in range(slots):
        _, reward, _, _, _ = env.step({"auv_0": env.action_space("auv_0").sample()})
        found.append(reward["auv_0"])
    return found


@pytest.mark.parametrize(
    ("operation", "function"),
    [
        ("`exp`", lambda xp, state: xp.sum(xp.exp(-state.age), axis=-1, keepdims=True)),
        ("`sort`", lambda xp, state: xp.sort(state.age, axis=-1)[:, :1]),
        ("power 3", lambda xp, state: state.age[:, :1] ** 3),
        (
            "AttributeError",
            lambda xp, state: state.age[:, :1] * (1 if (state.age > 3).any() else 2),
        ),
    ],
)
def test_what_cannot_be_traced_is_named_once_and_played_on_arrays(registered, operation, function):
    scenario = registered(function)
    with pytest.warns(RuntimeWarning, match=f"on arrays.*test_tracing_fallback.*{operation}"):
        found = rewards_of(iout_v0.parallel_env(scenario))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        again = rewards_of(iout_v0.parallel_env(scenario))
    assert again == found
    assert np.isfinite(found).all()
    assert len(set(found)) > 1


def test_what_can_be_traced_is(registered):
    scenario = registered(lambda xp, state: -xp.max(state.age, axis=-1, keepdims=True))
    assert unrolled_slot(scenario) is not None


def test_a_metric_that_cannot_be_traced():
    @metrics.register("wildness", unit="1", definition="A sum of exponentials.", per_slot=True)
    def wildness(world, state, events):
        return world.backend.xp.sum(world.backend.xp.exp(-state.age), axis=-1)

    try:
        with pytest.warns(RuntimeWarning, match="`exp`"):
            rewards_of(iout_v0.parallel_env("paper/k3-fdd"))
    finally:
        metrics.unregister("wildness")


def test_an_error_of_a_part_is_an_error():
    class Wrong(parts.Reward):
        def __call__(self, state, events):
            raise ZeroDivisionError("on purpose")

    parts.rewards.register("wrong", version=1)(Wrong)
    try:
        scenario = load_scenario("paper/k3-fdd", {"reward": {"kind": "wrong"}})
        where = r"reward 'wrong': raises ZeroDivisionError: on purpose \(.*fallback.py:\d+\)"
        with pytest.raises(InputError, match=where):
            iout_v0.parallel_env(scenario)
    finally:
        parts.rewards.unregister("wrong")
