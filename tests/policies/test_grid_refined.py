"""What can be reached depends on the water and the vehicle, not on how the grid is cut."""

import numpy as np
import pytest

from iout_marl import evaluate, load_scenario
from iout_marl.policies import Budget, PlannerPolicy, Tour

pytestmark = pytest.mark.slow

#: Six nodes in a bay of 480 m × 480 m, in metres.
NODES_M = np.array([[30, 30], [450, 90], [210, 210], [90, 390], [390, 450], [270, 30]])
#: W of charging: energy binds, and does not.
SCARCE, AMPLE = 100.0, 3e5


def bay(edge_m, slot_s=15.0, power_w=SCARCE):
    """The bay in cells of that edge, its nodes and the AUV in those of their places."""

    def cell(place_m):
        return [*(int(m // edge_m) + 1 for m in place_m), 1]

    cells = round(480 / edge_m)
    settings = {
        "grid.cells": [cells, cells, 1],
        "grid.spacing_m": edge_m,
        "nodes.cells": [cell(place) for place in NODES_M],
        "nodes.count": 6,
        "auvs.start_cells": [cell((210, 270))],
        "auvs.motion": "hover",
        "age.maximum": 1000,
        "charging.power_w": power_w,
        "episode.slot_s": slot_s,
        "episode.duration_s": 600.0,
    }
    return load_scenario("paper/k10-fdd", settings)


def seconds(scenario, policy):
    """Mean AoI in s."""
    return evaluate(scenario, policy, 1).metrics["mean_aoi"].mean * scenario.slot_s


def test_a_finer_grid_changes_what_a_plan_reaches_by_its_own_error_alone():
    # 60 m a slot: one cell, two, three, six, twelve. Cells move places by half an edge at most.
    found = [seconds(bay(edge), PlannerPolicy(Budget(rounds=0))) for edge in (60, 30, 20, 10, 5)]
    assert max(found) / min(found) < 1.02
    tours = [seconds(bay(edge), Tour()) for edge in (60, 30, 20, 10, 5)]
    assert max(tours) / min(tours) < 1.02


def test_slots_that_follow_from_cells_make_age_a_matter_of_the_grid_those_of_their_own_do_not():
    coarse, fine = (seconds(bay(edge, None, AMPLE), Tour()) for edge in (60, 5))
    assert coarse / fine > 10
    coarse, fine = (seconds(bay(edge, 15.0, AMPLE), Tour()) for edge in (60, 5))
    assert coarse / fine == pytest.approx(1, abs=0.02)


@pytest.mark.parametrize("slot_s", [5.0, 4.0])
def test_plans_know_what_time_moves_take(slot_s):
    scenario = bay(60, slot_s)
    tour = seconds(scenario, Tour())
    plan = seconds(scenario, PlannerPolicy(Budget(rounds=1)))
    # Shorter slots carry more packets, over the same way.
    assert plan <= tour < seconds(bay(60, 15.0), Tour())
    assert plan < seconds(scenario, "random-walk")
