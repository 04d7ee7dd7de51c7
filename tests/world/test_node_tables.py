"""Node tables: rows of nodes and of other AUVs, whatever their number and numbering, in any sea."""

import numpy as np
import pytest
import torch
from batteries import BATTERY, DOCKS

from iout_marl import World, load_scenario
from iout_marl.core.table import TableLayout, flattened
from iout_marl.parts.entry.rank import count_greater
from iout_marl.physics.arrays import namespace
from iout_marl.testing.parts import permuted_actions
from iout_marl.testing.recorded import (
    actions_for,
    chance_for,
    episode,
    first_state,
    permuted,
    permuted_chance,
)

SEEDS = (3, 4)
TEAM = {"auvs.start_cells": [[2, 2, 1], [4, 2, 1], [1, 3, 2], [3, 1, 2]]}
MOTOR = {**BATTERY, **DOCKS, "max_speed_m_per_s": 4.5}
TIDE = {"kind": "tide", "speed_m_per_s": 1.0, "toward_deg": 30.0}
WEIGHTS = {
    "kind": "fixed",
    "cells": [[1, 1, 1], [4, 3, 2], [2, 3, 1]],
    "weights": [1.0, 3.0, 0.5],
}


def nodes(count):
    return {"nodes": {"kind": "random", "count": count}}


#: Whatever may make a table another one, by name: a bundled scenario, and changes of it.
WORLDS = {
    "one node": ("paper/k5-fdd", nodes(1)),
    "one AUV, TDD": ("paper/k7-tdd", {}),
    "four AUVs": ("paper/k5-fdd", nodes(9) | TEAM),
    "four AUVs, TDD, one band": ("best/k5-tdd", TEAM | {"channel.access": "interference"}),
    "small grid": ("paper/k5-fdd", nodes(4) | TEAM | {"grid.cells": [6, 6, 2]}),
    "large grid": ("paper/k5-fdd", nodes(20) | TEAM | {"grid.cells": [20, 20, 6]}),
    "current and batteries": (
        "paper/k5-fdd",
        nodes(4) | TEAM | {"vehicle": MOTOR, "current": TIDE, "grid.cells": [6, 6, 2]},
    ),
    "stores": ("paper/k5-fdd", {"storage": {"kind": "capacitor", "capacity_j": 900.0}}),
    "weights": ("paper/k5-fdd", {"nodes": WEIGHTS}),
    "view": ("paper/k5-fdd", nodes(6) | TEAM | {"observation.view_range_m": 120}),
    "more entries": (
        "paper/k5-fdd",
        nodes(6) | TEAM | {"observation.entries": ["ages", "time", "harvests"]},
    ),
}


@pytest.fixture(params=WORLDS)
def scenario(request):
    base, changes = WORLDS[request.param]
    short = {"episode.duration_s": 800, "charging.power_w": 60000}
    return load_scenario(base, {"observation": "table"} | short | changes)


def played(scenario, order=None, **backend):
    """An episode of random actions, with nodes or AUVs in another order."""
    order = order or {}
    world = World(scenario, len(SEEDS), **backend)
    start = first_state(world, SEEDS)
    start = permuted(start, **order) if order else start
    actions = permuted_actions(actions_for(world, 0), **order)
    chance = (drawn and permuted_chance(drawn, **order) for drawn in chance_for(world, SEEDS))
    return world, episode(world, start, actions, chance=chance)


def tables_of(slot):
    return {name: v for name, v in slot.values.items() if name.startswith("table")}


@pytest.mark.slow
def test_rows_lie_within_their_ranges_and_make_the_vector(scenario):
    world, slots = played(scenario)
    layout, ranges = world.observer.layout, world.observer.agent_ranges
    assert layout.size == len(ranges.low)
    for slot in slots:
        vectors = slot.values["observation"]
        assert np.isfinite(vectors).all()
        assert (vectors >= ranges.low - 1e-12).all()
        assert (vectors <= ranges.high + 1e-12).all()
        rows = layout.rows(vectors)
        assert rows["nodes"].shape[2:] == (world.num_nodes, layout.node_entries)
        assert rows.get("auvs", np.empty((0, 0, 0))).shape[2] == world.num_auvs - 1
        np.testing.assert_array_equal(flattened(rows), vectors)


@pytest.mark.slow
@pytest.mark.parametrize("of", ["nodes", "auvs"])
def test_renumbering_moves_rows_alone(scenario, of):
    count = {"nodes": scenario.num_nodes, "auvs": scenario.num_auvs}[of]
    order = {of: np.roll(np.arange(count), 1)[::-1]}
    if of == "nodes" and len(set(scenario.node_weights)) > 1:
        pytest.skip("the weights of nodes stay where they are")
    slots, again = played(scenario)[1], played(scenario, order)[1]
    assert tables_of(slots[0])
    for one, other in zip(slots, again, strict=True):
        for name, rows in tables_of(one.permuted(**order)).items():
            np.testing.assert_allclose(other.values[name], rows, 1e-9, 1e-9, err_msg=name)


@pytest.mark.slow
def test_torch_gives_the_same(scenario):
    slots, again = played(scenario)[1], played(scenario, library=torch)[1]
    for one, other in zip(slots, again, strict=True):
        np.testing.assert_allclose(
            one.values["observation"], other.values["observation"], 1e-9, 1e-9
        )


@pytest.mark.slow
def test_float32_gives_the_same(scenario):
    slots, again = played(scenario)[1], played(scenario, dtype="float32")[1]
    for one, other in zip(slots, again, strict=True):
        assert other.values["observation"].dtype == np.float32
        np.testing.assert_allclose(
            one.values["observation"], other.values["observation"], 1e-3, 1e-4
        )


def test_rows_of_a_layout():
    layout = TableLayout(
        context=2, auvs=2, auv_columns=1, nodes=3, node_columns=2, moves=2, move_columns=1
    )
    rows = layout.rows(np.arange(layout.size))
    assert rows["context"].tolist() == [0, 1]
    assert rows["auvs"].tolist() == [[2], [3]]
    # Of a node: its two columns, then that of moves by either direction.
    assert rows["nodes"].tolist() == [[4, 7, 10, 13], [5, 8, 11, 14], [6, 9, 12, 15]]


def test_flattened_takes_observations_that_are_joined_end_to_end():
    layout = TableLayout(
        context=2, auvs=1, auv_columns=3, nodes=3, node_columns=2, moves=2, move_columns=1
    )
    vectors = np.random.default_rng(0).random((4, 2, layout.size))
    joined = {
        name: rows.reshape(4, -1, *rows.shape[3:]) for name, rows in layout.rows(vectors).items()
    }
    np.testing.assert_array_equal(flattened(joined, 2), vectors.reshape(4, -1))


@pytest.mark.parametrize("library", [np, torch], ids=["numpy", "torch"])
@pytest.mark.parametrize("count", [1, 10, 64, 65, 200])
@pytest.mark.parametrize("kinds", [1, 3, 50, 10_000])
def test_older_nodes_are_counted_among_few_and_many(library, count, kinds):
    values = np.random.default_rng(count).integers(0, kinds, (3, 2, count)).astype(np.float32)
    xp = namespace(library.asarray(values))
    counted = np.asarray(count_greater(xp, library.asarray(values)))
    assert (counted == (values[..., None, :] > values[..., :, None]).sum(-1)).all()
