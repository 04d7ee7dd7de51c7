"""Laws that hold whatever the AUVs do."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from iout_marl.scenario import load_scenario
from iout_marl.world import World, node_codes, pin_layout

NAMES = ("paper/k5-fdd", "paper/k5-tdd", "best/k5-tdd")
STARTS = [[5, 5, 2], [1, 1, 1], [9, 9, 4]]


def play(scenario, actions, layout=None):
    """States and events of an episode of (slots, envs, auvs, entries) actions."""
    world = World(scenario, actions.shape[1])
    rngs = [np.random.default_rng(i) for i in range(actions.shape[1])]
    state = world.reset(node_codes(scenario, world.grid, rngs) if layout is None else layout)
    history = [(state, None)]
    for action in actions:
        history.append(world.step(history[-1][0], action))
    return world, history


def draw_actions(scenario, seed, slots=60, envs=2):
    rng = np.random.default_rng(seed)
    sizes = World(scenario).action_sizes
    shape = (slots, envs, scenario.num_auvs)
    return np.stack([rng.integers(0, n, shape) for n in sizes], axis=-1)


ACCESS = ("orthogonal", "interference", "exclusive")
scenarios = st.builds(
    lambda name, auvs, access, idle_choices: load_scenario(
        name,
        {
            "auvs.start_cells": STARTS[:auvs],
            "auvs.idle_choices": idle_choices,
            "channel.access": access,
        },
    ),
    st.sampled_from(NAMES),
    st.integers(1, 3),
    st.sampled_from(ACCESS),
    st.booleans(),
)
laws = settings(max_examples=25, deadline=None)


@pytest.mark.slow
@laws
@given(scenarios, st.integers(0, 10**6))
def test_energy_is_conserved_to_the_joule(scenario, seed):
    _, history = play(scenario, draw_actions(scenario, seed))
    for state, _ in history:
        stored = state.energy_j.sum(axis=1)
        np.testing.assert_allclose(state.harvested_j - state.spent_j, stored, atol=1e-6)
        assert (state.energy_j >= 0).all()


@pytest.mark.slow
@laws
@given(scenarios, st.integers(0, 10**6))
def test_ages_rise_by_one_or_fall_to_one(scenario, seed):
    _, history = play(scenario, draw_actions(scenario, seed))
    maximum = scenario.age.maximum
    for (before, _), (after, _) in itertools.pairwise(history):
        served = after.deliveries > before.deliveries
        assert (after.age[served] == 1).all()
        assert (after.age[~served] == np.minimum(before.age + 1, maximum)[~served]).all()


@pytest.mark.slow
@laws
@given(scenarios, st.integers(0, 10**6))
def test_no_node_delivers_twice_in_a_slot(scenario, seed):
    _, history = play(scenario, draw_actions(scenario, seed))
    for (before, _), (after, events) in itertools.pairwise(history):
        more = after.deliveries - before.deliveries
        assert set(np.unique(more)) <= {0.0, 1.0}
        assert (more.sum(axis=1) == events.delivered.sum(axis=1)).all()


@pytest.mark.slow
@laws
@given(scenarios, st.integers(0, 10**6))
def test_fairness_lies_between_one_node_and_all(scenario, seed):
    world, history = play(scenario, draw_actions(scenario, seed))
    for state, _ in history:
        served = state.deliveries.sum(axis=1) > 0
        assert (state.jain[~served] == 0).all()
        assert (state.jain[served] >= 1 / world.num_nodes - 1e-12).all()
        assert (state.jain <= 1 + 1e-12).all()


@pytest.mark.slow
@laws
@given(st.sampled_from(NAMES), st.integers(0, 10**6), st.permutations(range(5)))
def test_renumbering_the_nodes_renumbers_the_results(name, seed, order):
    scenario = load_scenario(name)
    actions = draw_actions(scenario, seed, envs=1)
    _, history = play(scenario, actions)
    renumbered = actions.copy()
    renumbered[..., 1:] = np.argsort(order)[actions[..., 1:]]
    layout = history[0][0].node_cell[:, order]
    _, permuted = play(scenario, renumbered, layout)
    for (state, _), (other, _) in zip(history, permuted, strict=True):
        np.testing.assert_array_equal(state.age[:, order], other.age)
        np.testing.assert_array_equal(state.energy_j[:, order], other.energy_j)
        np.testing.assert_allclose(state.mean_age, other.mean_age, rtol=1e-12)


@pytest.mark.slow
@laws
@given(scenarios, st.integers(0, 10**6))
def test_a_batch_is_its_environments_one_by_one(scenario, seed):
    actions = draw_actions(scenario, seed, envs=3)
    world, batch = play(scenario, actions)
    last = batch[-1][0]
    for i in range(3):
        layout = batch[0][0].node_cell[i : i + 1]
        single, alone = play(scenario, actions[:, i : i + 1], layout)
        np.testing.assert_array_equal(alone[-1][0].energy_j[0], last.energy_j[i])
        np.testing.assert_array_equal(alone[-1][0].age[0], last.age[i])
        metrics = single.metrics(alone[-1][0])
        for name, values in world.metrics(last).items():
            np.testing.assert_allclose(values[i], metrics[name][0])


def fdd_slot(scenario, action, energy_j=0.0):
    """The slot of one FDD action, with all nodes holding `energy_j`."""
    world = World(scenario)
    rng = np.random.default_rng(0)
    state = world.reset(node_codes(scenario, world.grid, [rng]))
    state = state.map(lambda a: a + energy_j if a is state.energy_j else a)
    return world.step(state, np.array([action]))


def test_node_charged_in_a_slot_can_transmit_in_it():
    near = load_scenario("paper/k3-fdd", {"auvs.start_cells": [[2, 1, 1]]})
    _, events = fdd_slot(near, [[1, 0, 0]])  # onto node 0, charging and hearing it
    assert events.delivered.item()
    _, events = fdd_slot(near, [[1, 1, 0]])  # the same, charging another node
    assert not events.delivered.item()


def test_two_auvs_charge_one_node_with_the_sum_of_both():
    starts = [[2, 1, 1], [1, 4, 1]]
    both = load_scenario("paper/k3-fdd", {"auvs.start_cells": starts})
    state, _ = fdd_slot(both, [[0, 0, 1], [2, 0, 1]])
    alone = [
        fdd_slot(load_scenario("paper/k3-fdd", {"auvs.start_cells": [start]}), [action])[0]
        for start, action in zip(starts, [[0, 0, 1], [2, 0, 1]], strict=True)
    ]
    assert state.energy_j[0, 0] == pytest.approx(sum(s.energy_j[0, 0] for s in alone))


@pytest.mark.parametrize("swapped", [False, True])
def test_node_heard_by_two_delivers_once_to_the_nearer(swapped):
    starts, actions = [[2, 1, 1], [1, 5, 1]], [[0, 1, 0], [2, 1, 0]]
    order = [1, 0] if swapped else [0, 1]
    scenario = load_scenario("paper/k3-fdd", {"auvs.start_cells": [starts[i] for i in order]})
    state, events = fdd_slot(scenario, [actions[i] for i in order], energy_j=500.0)
    assert events.delivered[0].tolist() == [i == 0 for i in order]
    assert state.deliveries[0].tolist() == [1, 0, 0]
    assert state.spent_j.item() == pytest.approx(500 - state.energy_j[0, 0])


def test_leaving_the_grid_changes_nothing_but_the_flag():
    scenario = load_scenario("paper/k3-fdd", {"auvs.start_cells": [[10, 10, 4]]})
    for direction in (0, 2, 4):
        state, events = fdd_slot(scenario, [[direction, 0, 0]])
        assert events.left_grid.item()
        world = World(scenario)
        np.testing.assert_array_equal(world.observe(state)[0, 0, :3], [10, 10, 4])


def test_weights_weigh_the_ages_in_the_reward():
    scenario = load_scenario(
        "paper/k3-fdd", {"nodes.weights": [3.0, 0.0, 0.0], "reward.kind": "mean_age"}
    )
    state, events = fdd_slot(scenario, [[0, 0, 1]])
    assert World(scenario).reward(state, events).item() == -state.age[0, 0]


def test_random_layouts_have_one_node_a_cell_and_are_pinned_by_the_seed_of_a_run():
    keys = {"nodes.kind": "random", "nodes.count": 30, "nodes.redraw": "run"}
    scenario = load_scenario("paper/k3-fdd", keys)
    pinned = pin_layout(scenario, 3)
    assert len(set(pinned.nodes.cells)) == 30
    assert pinned == pin_layout(scenario, 3) != pin_layout(scenario, 4)
    assert pin_layout(pinned, 5) is pinned
    fixed = load_scenario("paper/k3-fdd")
    assert pin_layout(fixed, 1) is fixed


def test_starts_that_are_not_given_spread_out():
    world = World(load_scenario("paper/k3-fdd", {"auvs.count": 5}))
    starts = world.grid.coordinate_table()[world.reset(np.zeros((1, 3), int)).cell[0]] + 1
    assert starts[0].tolist() == [5, 5, 2]
    assert len({tuple(cell) for cell in starts.tolist()}) == 5
    # The corners far from the middle of ten cells.
    assert starts[1:].tolist() == [[10, 10, 4], [1, 10, 4], [10, 1, 4], [1, 1, 4]]


def test_hovering_stays_and_is_no_move_out_of_the_grid():
    scenario = load_scenario(
        "paper/k3-fdd", {"auvs.motion": "hover", "auvs.start_cells": [[1, 1, 1]]}
    )
    world = World(scenario)
    assert world.action_sizes == (7, 3, 3)
    state = world.reset(np.zeros((1, 3), int))
    after, events = world.step(state, np.array([[[6, 0, 0]]]))
    assert (after.cell == state.cell).all()
    assert not events.left_grid.any()
    _, events = world.step(state, np.array([[[1, 0, 0]]]))
    assert events.left_grid.all()
    assert world.action_mask(state)[0, 0, :7].tolist() == [1, 0, 1, 0, 1, 0, 1]


def moved(starts, directions, **changes):
    """Cells, and who was kept from moving, after one slot in a row of ten cells."""
    row = {"grid.cells": [10, 1, 1], "nodes.cells": [[1, 1, 1]], "nodes.count": 1}
    starts = {"auvs.start_cells": [[x, 1, 1] for x in starts]}
    scenario = load_scenario("paper/k3-fdd", {**row, **starts, "auvs.motion": "hover", **changes})
    world = World(scenario)
    state = world.reset(np.zeros((1, 1), int))
    after, events = world.step(state, np.array([[[d, 0, 0] for d in directions]]))
    cells = world.grid.coordinate_table()[after.cell[0]][:, 0] + 1
    return cells.tolist(), events.blocked[0].tolist()


RIGHT, LEFT, HOVER = 0, 1, 6


@pytest.mark.parametrize(
    ("starts", "directions", "cells", "blocked"),
    [
        ([2, 4], [RIGHT, LEFT], [2, 4], [1, 1]),  # into one cell
        ([2, 3], [RIGHT, LEFT], [2, 3], [1, 1]),  # past one another
        ([2, 3], [RIGHT, RIGHT], [3, 4], [0, 0]),  # one behind the other
        ([2, 3, 4], [RIGHT, RIGHT, HOVER], [2, 3, 4], [1, 1, 0]),  # up to one that stays
        ([1, 2, 3, 5], [RIGHT, RIGHT, RIGHT, LEFT], [1, 2, 3, 5], [1, 1, 1, 1]),  # a chain
        ([9, 10], [RIGHT, RIGHT], [9, 10], [1, 0]),  # the wall stops one, and it the other
        ([2, 5], [RIGHT, LEFT], [3, 4], [0, 0]),
    ],
)
def test_auvs_stay_where_their_moves_would_meet(starts, directions, cells, blocked):
    assert moved(starts, directions) == (cells, [bool(b) for b in blocked])


def test_a_wider_separation_keeps_them_farther_apart_and_none_lets_them_meet():
    assert moved([2, 5], [RIGHT, LEFT], **{"auvs.separation_cells": 2}) == ([2, 5], [True, True])
    assert moved([2, 4], [RIGHT, LEFT], **{"auvs.separation_cells": 0})[0] == [3, 3]


@pytest.mark.slow
@laws
@given(scenarios, st.integers(0, 10**6), st.sampled_from([1.0, 1.5, 2.0]))
def test_auvs_never_come_nearer_than_their_separation(scenario, seed, separation):
    small = {"grid.cells": [4, 3, 2], "nodes.cells": [[1, 1, 1], [2, 2, 2], [4, 3, 1]]}
    starts = {"auvs.start_cells": [[1, 1, 1], [4, 3, 2], [1, 3, 1]][: scenario.num_auvs]}
    changes = {**small, **starts, "nodes.count": 3, "auvs.separation_cells": separation}
    scenario = load_scenario(scenario, changes)
    world, history = play(scenario, draw_actions(scenario, seed))
    for state, _ in history:
        cells = world.grid.coordinate_table()[state.cell].astype(float)
        for a, b in itertools.combinations(range(scenario.num_auvs), 2):
            apart = np.linalg.norm(cells[:, a] - cells[:, b], axis=-1)
            assert (apart >= separation - 1e-9).all()
