"""Rewards of one's own with terms for all AUVs alike, evaluated and trained."""

import numpy as np
import pytest

from iout_marl import InputError, World, evaluate, load_scenario, parts
from trainers import Trainer


@pytest.fixture(autouse=True)
def _shared(forgotten_parts):
    @parts.rewards.register("shared", version=1)
    class Shared(parts.Reward):
        class Settings(parts.Settings):
            weight: parts.Positive = 1.0

        def __call__(self, state, events):
            worst = self.xp.max(state.age, axis=-1, keepdims=True)
            return {"worst": -self.settings.weight * worst, "more": 0 * worst}

    @parts.rewards.register("picky", version=1)
    class Picky(Shared):
        def check(self, scenario):
            if scenario.num_auvs > 2:
                raise InputError("is for two AUVs at most")


def test_terms_for_all_auvs_alike_reach_each_of_them(tiny):
    scenario = tiny({"auvs.count": 2, "reward": {"kind": "shared"}})
    world = World(scenario, 3)
    state, events = world.step(world.reset(seed=0), np.zeros((3, 2, 3), dtype=np.int64))
    reward = world.reward(state, events)
    assert reward.shape == (3, 2)
    np.testing.assert_array_equal(reward, -np.repeat(state.age.max(-1, keepdims=True), 2, axis=1))
    assert evaluate(scenario, "greedy", 1).metrics["reward"].mean < 0


def test_a_training_takes_them(tiny):
    log = Trainer(tiny({"auvs.count": 2, "reward": {"kind": "shared"}})).iterate()
    assert log["reward/worst"] < 0


def test_a_part_may_refuse_a_scenario_in_its_own_words(tiny):
    with pytest.raises(InputError, match=r"is for two AUVs at most$"):
        load_scenario(tiny(), {"auvs.count": 3, "reward": {"kind": "picky"}})
    assert load_scenario(tiny(), {"auvs.count": 2, "reward": {"kind": "picky"}}).num_auvs == 2
