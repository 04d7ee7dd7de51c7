"""Small worlds and the least age sum in each, by playing every action there is."""

import numpy as np

from iout_marl import load_scenario
from iout_marl.world import State, World, node_codes


def small_world(
    rng,
    duplex="fdd",
    motion="six",
    nodes=2,
    slots=5,
    rule="paper",
    auvs=1,
    access="orthogonal",
    *,
    is_oblong=False,
    idle_choices=False,
    polls=None,
):
    """A 3 × 3 × 1 grid with wide cells, oblong ones perhaps, on which energy binds."""
    cells = rng.permutation([(x, y, 1) for x in (1, 2, 3) for y in (1, 2, 3)])
    spacing_m = float(rng.uniform(100, 450))
    settings = {
        "grid.cells": [3, 3, 1],
        "grid.spacing_m": spacing_m,
        "nodes.cells": cells[:nodes].tolist(),
        "nodes.count": None,
        "auvs.start_cells": cells[-auvs:].tolist(),
        "auvs.motion": motion,
        "auvs.separation_cells": 0,
        "auvs.idle_choices": idle_choices,
        "channel.access": access,
        "episode.duration_s": slots * spacing_m / 4,
        "charging.power_w": float(2000 * 10 ** rng.uniform(-1.3, 0.3)),
        "age.initial": int(rng.integers(1, 4)),
        "age.maximum": int(rng.choice([4, 50])),
    }
    if duplex == "tdd":
        settings["duplex.beta_rule"] = rule
    if is_oblong:  # with the slots as they were
        settings["grid.spacing_m"] = [spacing_m, 0.4 * spacing_m, 0.1 * spacing_m]
        settings["grid.own_cell_distance"] = "mean"
    if rule in ("modem", "airtime"):
        settings |= at_sea(rng, spacing_m, slots)
    if polls:
        settings["hearing"] = {"kind": "polling", "max_nodes_per_slot": polls}
    return load_scenario(f"paper/k3-{duplex}", settings)


def at_sea(rng, spacing_m, slots):
    """Apertures and modems, whose packets take a slot's harvest or more, some out of range."""
    spacing_m = spacing_m / 10
    return {
        "grid.spacing_m": spacing_m,
        "episode.duration_s": slots * spacing_m / 0.5,
        "auvs.speed_m_per_s": 0.5,
        "channel": {"kind": "sonar", "spreading_factor": 2.0},
        "harvester": {"kind": "aperture", "area_m2": 0.02, "efficiency": 0.5},
        "uplink": {
            "kind": "modem",
            "bit_rate_bps": 1000.0,
            "packet_bits": float(rng.uniform(2000, 18_000)),
            "bandwidth_hz": 3000.0,
            "electronics_w": float(10 ** rng.uniform(-1, 1)),
            "maximum_source_level_db": float(rng.uniform(101, 110)),
        },
    }


def least_age_sum(scenario):
    """The optimum: the least sum of ages over nodes and slots, where those are whole."""
    return round(least_sum_over_time(scenario))


def least_sum_over_time(scenario, seed=0):
    """The optimum: the least sum of ages over nodes and slots, or over time.

    States of the world are alike if cells, moves that are not over, ages and energies, those of
    batteries too, are. What is left to chance is what the seed draws.
    """
    world = World(scenario)
    state = world.reset(node_codes(scenario, world.grid, [np.random.default_rng(0)]))
    one_auv = np.stack(np.meshgrid(*map(np.arange, world.action_sizes)), -1)
    one_auv = one_auv.reshape(-1, len(world.action_sizes))
    choices = np.stack(np.meshgrid(*[np.arange(len(one_auv))] * world.num_auvs), -1).reshape(
        -1, world.num_auvs
    )
    actions = one_auv[choices]
    chance = world.draw_chance(seed)
    for _ in range(scenario.num_slots):
        rows, drawn = len(state.slot), next(chance)
        batch = state.map(lambda array: np.repeat(array, len(actions), axis=0))
        step = World(scenario, rows * len(actions))
        each = drawn and drawn.map(lambda a, n=step.num_envs: np.repeat(a, n, axis=0))
        state, _ = step.step(batch, np.tile(actions, (rows, 1, 1)), each)
        under_way = state.transit_slots, np.where(state.transit_slots > 0, state.course, 0)
        energies = state.energy_j.round(6), state.battery_j.round(6)
        same = np.concatenate([state.cell, *under_way, state.age, *energies], axis=1)
        order = np.lexsort((state.age_sum, *same.T))
        differs = (same[order][1:] != same[order][:-1]).any(axis=1)
        state = State(*(array[order[np.append(True, differs)]] for array in state))
    return float(state.age_sum.min()) * scenario.num_nodes
