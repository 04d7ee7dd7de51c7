"""Rounds and plans in currents: nobody is stranded in a tide."""

import numpy as np
import pytest

from iout_marl import World, evaluate, load_scenario
from iout_marl.policies import Return
from iout_marl.policies.simulator import Simulator

TIDE = {"kind": "tide", "speed_m_per_s": 0.3, "toward_deg": 40.0}
DOCK = {"vehicle.docks": [[1, 1, 2]], "vehicle.dock_power_w": 3000.0}


@pytest.mark.slow
@pytest.mark.parametrize("capacity_j", [2.5e6, 6e6])
@pytest.mark.parametrize("phase_deg", [0.0, 180.0])
def test_return_strands_nobody_in_the_bay(phase_deg, capacity_j):
    """With batteries that last for a small part of the day."""
    scenario = load_scenario(
        "sea/bay",
        {
            **DOCK,
            "current": {**TIDE, "phase_deg": phase_deg},
            "vehicle.max_speed_m_per_s": 2.5,
            "vehicle.capacity_j": capacity_j,
        },
    )
    found = evaluate(scenario, "return", 1).metrics
    assert found["stranded_share"].mean == 0
    assert found["docked_kj"].mean > capacity_j / 1000
    assert found["uplink_success"].mean > 0.3


def test_return_keeps_enough_for_a_way_home_against_the_current():
    """It leaves for home earlier than it would in still water."""
    changes = {**DOCK, "vehicle.capacity_j": 4e6, "auvs.start_cells": [[12, 8, 2]]}
    left = []
    for current in ("none", {**TIDE, "speed_m_per_s": 0.9}):
        world = World(load_scenario("sea/bay", {**changes, "current": current}))
        policy, state = Return(), world.reset(seed=0)
        policy.act(world, state, np.random.default_rng(0))
        home_j = policy._energy_home_j(world)
        left.append(home_j[0, state.cell[0, 0]])
    assert left[1] > 2 * left[0]


def test_ways_of_plans_go_round_impossible_directions():
    changes = {"current": {"kind": "uniform", "speed_m_per_s": 1.5, "toward_deg": 270.0}}
    scenario = load_scenario("sea/bay", {**changes, "vehicle.max_speed_m_per_s": 2.5})
    simulator = Simulator(scenario)
    state, world = simulator.world.reset(), simulator.world
    target = np.array([[int(world.grid.encode([5, 2, 1]))]])
    right, ahead = 0, 2
    assert not world.manoeuvre.open(state)[0, 0, right]
    assert simulator.towards(state, target)[0, 0] == ahead
