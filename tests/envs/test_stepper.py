"""A single episode is played number by number, as arrays would play it."""

import numpy as np
import pytest

from iout_marl import iout_v0
from iout_marl.envs.episodes import EpisodeBatch
from iout_marl.envs.stepper import ArrayStepper, TracedStepper
from iout_marl.scenario import load_scenario


@pytest.mark.slow
@pytest.mark.parametrize("mask", ["none", "info"])
@pytest.mark.parametrize("name", ["paper/k5-fdd", "best/k5-tdd", "multi/m3-k10-fdd"])
def test_number_by_number_is_as_by_arrays(name, mask):
    episodes = EpisodeBatch(load_scenario(name, {"observation.action_mask": mask}))
    episodes.reset([3])
    unrolled = episodes._stepper
    assert isinstance(unrolled, TracedStepper)
    batched = ArrayStepper(episodes.world, episodes.current, None)
    rng = np.random.default_rng(0)
    for _ in range(20):
        shape = (1, episodes.world.num_auvs)
        sizes = episodes.world.action_sizes
        action = np.stack([rng.integers(0, n, shape) for n in sizes], axis=-1)
        np.testing.assert_array_equal(unrolled.step(action), batched.step(action))
        for method in ("observe", "masks"):
            found, expected = getattr(unrolled, method)(), getattr(batched, method)()
            assert found.dtype == expected.dtype
            np.testing.assert_array_equal(found, expected)
        for name in ("slot", "mean_age", "age_sum", "peak_age", "jain", "harvested_j", "spent_j"):
            assert unrolled.now(name).dtype == batched.now(name).dtype
            np.testing.assert_array_equal(unrolled.now(name), batched.now(name))
            assert repr(unrolled.first_now(name)) == repr(batched.first_now(name))
        for name in ("harvested_j", "delivered", "beta"):
            assert unrolled.last(name).dtype == batched.last(name).dtype
            np.testing.assert_array_equal(unrolled.last(name), batched.last(name))
            assert repr(unrolled.first_last(name)) == repr(batched.first_last(name))
        for found, expected in zip(
            (*unrolled.state, *unrolled.events), (*batched.state, *batched.events), strict=True
        ):
            np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize(
    ("name", "auvs", "kind"),
    [("paper/k10-fdd", 1, TracedStepper), ("multi/m4-k10-fdd", 5, ArrayStepper)],
)
def test_environments_are_played_the_faster_way(name, auvs, kind):
    env = iout_v0.parallel_env(load_scenario(name, {"auvs.count": auvs}))
    env.reset(seed=0)
    assert isinstance(env._episodes._stepper, kind)
