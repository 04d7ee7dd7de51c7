"""The round that returns to a dock in time: nobody is stranded, and data still arrive."""

import numpy as np
import pytest
from batteries import BATTERY

from iout_marl import World, evaluate, load_scenario
from iout_marl.evaluation import play
from iout_marl.policies import Return, make_baseline

DOCK = {"docks": [[3, 3, 1]], "dock_power_w": 20000.0}
HOVER = {"auvs.motion": "hover", "auvs.idle_choices": True}
CASES = {
    "fdd": ("paper/k5-fdd", {}),
    "fdd hover": ("paper/k5-fdd", HOVER),
    "tdd": ("best/k5-tdd", {}),
    "tdd hover": ("best/k5-tdd", HOVER),
    "boxes": ("paper/k5-fdd", {**HOVER, "grid.spacing_m": [100, 60, 40]}),
    "random": ("random/k5-fdd", HOVER),
    "two AUVs": ("paper/k5-fdd", {**HOVER, "auvs.start_cells": [[5, 5, 2], [1, 2, 1]]}),
}


def scenario_of(case, **vehicle):
    name, changes = CASES[case]
    return load_scenario(name, {**changes, "vehicle": {**BATTERY, **DOCK, **vehicle}})


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_returns_in_time(case):
    vehicle = {"capacity_j": {"fdd": 2e6, "tdd": 2e6}.get(case, 1e6)}
    if case == "two AUVs":  # docks of their own
        vehicle["docks"] = [[5, 5, 1], [1, 2, 1]]
    found = evaluate(scenario_of(case, **vehicle), "return", 2).metrics
    assert found["stranded_share"].mean == 0
    assert found["docked_kj"].mean > 0
    assert found["uplink_success"].mean > 0.1


@pytest.mark.slow
def test_by_a_rule_that_charges_whom_it_hears_nobody_is_heard_on_the_way_back():
    changes = {
        "duplex": {"kind": "tdd", "frequency_khz": 30, "beta_rule": "airtime"},
        "vehicle.docks": [[1, 1, 2]],
        "vehicle.dock_power_w": 2500,
        "vehicle.capacity_j": 2e6,
    }
    found = evaluate(load_scenario("sea/bay", changes), "return", 1).metrics
    assert found["stranded_share"].mean == 0
    assert found["docked_kj"].mean > 0


def test_without_returning_it_would_be_stranded():
    scenario = scenario_of("fdd hover", capacity_j=1e6)
    assert evaluate(scenario, "tour", 1).metrics["stranded_share"].mean > 0.3


def test_recharges_until_it_is_nearly_full_and_goes_on():
    scenario = scenario_of("fdd hover", capacity_j=1e6, dock_power_w=6000.0)
    world = World(scenario)
    rests, shares = 0, []
    for state, _ in play(world, Return()):
        at_dock = state.cell[0, 0] == world.grid.encode(np.array([2, 2, 0]))
        rests += int(at_dock)
        shares.append(float(state.battery_j[0, 0]) / 1e6)
    assert rests > 3
    assert max(shares[5:]) >= 0.95
    # Of a battery that is full it has spent half at least before it is full again.
    assert min(shares) < 0.5


@pytest.mark.parametrize("changes", [{}, {"vehicle": BATTERY}], ids=["unlimited", "no dock"])
def test_without_docks_it_goes_round(changes):
    scenario = load_scenario("paper/k5-fdd", changes)
    assert evaluate(scenario, "return", 1).metrics["uplink_success"].mean > 0


def test_an_episode_begins_anew():
    scenario = scenario_of("two AUVs", capacity_j=1e6)
    policy, world = make_baseline("return"), World(scenario)
    episodes = [[state.cell for state, _ in play(world, policy)] for _ in range(2)]
    assert np.array_equal(*episodes)


#: Docks that are shared, side by side, in the way of others, and far from starts.
FLEETS = {
    "a dock for two": ([[7, 5, 1]], [[6, 5, 1], [8, 5, 1]], 14.4e6),
    "berths side by side": ([[7, 5, 1], [7, 6, 1]], [[6, 5, 1], [8, 5, 1]], 14.4e6),
    "a row of berths": (
        [[5, 5, 1], [6, 5, 1], [7, 5, 1]],
        [[4, 2, 1], [8, 8, 1], [12, 5, 1], [13, 4, 1]],
        14.4e6,
    ),
    "in one another's way": ([[7, 6, 1], [2, 7, 1]], [[7, 9, 1], [8, 1, 1]], 5e6),
    "a dock for three": ([[5, 5, 1]], [[11, 9, 1], [2, 3, 1], [5, 5, 1]], 14.4e6),
}


@pytest.mark.slow
@pytest.mark.parametrize(("docks", "starts", "capacity_j"), FLEETS.values(), ids=FLEETS)
def test_several_auvs_get_past_one_another_to_their_docks(docks, starts, capacity_j):
    changes = {
        "grid.cells": [13, 9, 3],
        "grid.spacing_m": [200, 200, 20],
        "nodes.cells": [[x, y, 3] for y in (2, 5, 8) for x in (2, 5, 9, 12)],
        "auvs.start_cells": [[x, y, 2] for x, y, _ in starts],
        "auvs.speed_m_per_s": 2.0,
        "episode.duration_s": 86_400,
        "vehicle.capacity_j": capacity_j,
        "vehicle.docks": [[x, y, 2] for x, y, _ in docks],
        "vehicle.dock_power_w": 3000,
    }
    found = evaluate(load_scenario("sea/bay", changes), "return", 1).metrics
    assert found["stranded_share"].mean == 0
    assert found["docked_kj"].mean > 2 * capacity_j / 1000
