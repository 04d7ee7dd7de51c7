"""Trainings compute in float32, environments and evaluations in float64: both decide alike."""

import numpy as np
import pytest

from iout_marl import World, bundled_names, load_scenario
from iout_marl.testing.recorded import actions_for, chance_for, first_state

#: What a slot decides by comparing numbers, and what is whole: ages too, unless taken over time.
DECISIONS = ("left_grid", "blocked", "charged", "heard", "delivered")
WHOLE = ("cell", "age", "deliveries")


@pytest.mark.slow
@pytest.mark.parametrize("name", bundled_names())
def test_the_same_actions_lead_to_the_same_decisions(name):
    scenario = load_scenario(name)
    worlds = [World(scenario, 4, dtype=dtype) for dtype in ("float32", "float64")]
    states = [first_state(world, range(4)) for world in worlds]
    chances = [chance_for(world, range(4)) for world in worlds]
    for slot, action in enumerate(actions_for(worlds[1], 0)):
        masks = [world.action_mask(state) for world, state in zip(worlds, states, strict=True)]
        np.testing.assert_array_equal(*masks, err_msg=f"slot {slot}: mask")
        played = [
            w.step(s, action, next(c)) for w, s, c in zip(worlds, states, chances, strict=True)
        ]
        states, events = zip(*played, strict=True)
        for field in DECISIONS:
            pair = (getattr(each, field) for each in events)
            np.testing.assert_array_equal(*pair, err_msg=f"slot {slot}: {field}")
        for field in WHOLE:
            first, second = (getattr(each, field) for each in states)
            if field == "age" and worlds[0].sampling.is_continuous:
                np.testing.assert_allclose(first, second, 1e-4, 1e-5, err_msg=f"slot {slot}")
                continue
            np.testing.assert_array_equal(first, second, err_msg=f"slot {slot}: {field}")
    rewards = [w.reward(s, e) for w, s, e in zip(worlds, states, events, strict=True)]
    np.testing.assert_allclose(*rewards, rtol=1e-4, atol=1e-4)
