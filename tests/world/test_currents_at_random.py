"""Currents, vehicles, paces and fleets drawn at random: the world goes where the oracle goes."""

import numpy as np
import pytest
from batteries import BATTERY, DOCKS
from oracle import Oracle

from iout_marl import World, load_scenario

pytestmark = pytest.mark.slow

STARTS = [[5, 5, 2], [1, 2, 1], [3, 1, 2]]


def draw_current(rng):
    speed, toward = float(rng.uniform(0.5, 4.0)), float(rng.uniform(0, 359))
    steady = {"speed_m_per_s": speed, "toward_deg": toward}
    kinds = {
        "uniform": steady,
        "shear": {**steady, "depth_scale_m": float(rng.uniform(50, 400))},
        "tide": {**steady, "speed_m_per_s": 4.9, "period_h": float(rng.uniform(0.1, 2))},
        "vortex": {
            "circulation_m2_per_s": float(rng.uniform(-9000, 9000)),
            "core_radius_m": float(rng.uniform(30, 300)),
            "center_m": rng.uniform(0, 400, 2).tolist(),
        },
        "double_gyre": {
            "amplitude_m_per_s": float(rng.uniform(0.5, 3.4)),
            "period_h": float(rng.uniform(0.1, 2)),
        },
    }
    kind = str(rng.choice(list(kinds)))
    return {"kind": kind, **kinds[kind]}


def draw_scenario(rng):
    limit = {"max_speed_m_per_s": float(rng.uniform(4, 7))}
    battery = {**BATTERY, "capacity_j": float(10 ** rng.uniform(5.8, 7.5))}
    vehicles = [
        {"kind": "unlimited", **limit},
        {**battery, **limit},
        {**battery, **limit, **DOCKS},
        battery,
    ]
    changes = {
        "vehicle": vehicles[rng.integers(4)],
        "current": draw_current(rng),
        "auvs.start_cells": STARTS[: int(rng.integers(1, 4))],
        "auvs.motion": str(rng.choice(["six", "hover", "planar"])),
        "auvs.separation_cells": float(rng.choice([0, 1, 2])),
        "episode.duration_s": 2000,
    }
    if slot_s := float(rng.choice([0, 10, 20, 60])):
        changes["episode.slot_s"] = slot_s
    if rng.random() < 0.3:
        changes["grid.spacing_m"] = [100, 80, 30]
    return load_scenario(str(rng.choice(["paper/k3-fdd", "best/k3-tdd"])), changes)


@pytest.mark.parametrize("seed", range(20))
def test_the_world_goes_where_the_oracle_goes(seed):
    rng = np.random.default_rng(seed)
    scenario = draw_scenario(rng)
    world, oracle = World(scenario), Oracle(scenario, scenario.nodes.cells[: scenario.num_nodes])
    state, shape = world.reset(seed=0), (1, scenario.num_auvs)
    for _ in range(world.num_slots):
        action = np.stack([rng.integers(0, n, shape) for n in world.action_sizes], -1)
        state, _ = world.step(state, action)
        oracle.step(action[0].tolist())
        cells = world.grid.coordinate_table()[state.cell[0]] + 1
        assert [tuple(cell) for cell in cells.tolist()] == oracle.auv_cells
        if world.vehicle.is_limited:
            assert (state.battery_j >= 0).all()
            assert state.battery_j[0] == pytest.approx(oracle.vehicles.battery_j, rel=1e-5, abs=1)
            assert state.distance_m[0] == pytest.approx(oracle.vehicles.distance_m)
