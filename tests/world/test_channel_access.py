"""Several AUVs on one band: what each way of sharing it does to their uplinks."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_world_laws import ACCESS, NAMES, draw_actions, play

from iout_marl.parts.access.interference import positive_solution
from iout_marl.scenario import load_scenario
from iout_marl.world import World

#: Four AUVs near one another and the nodes, so that uplinks disturb one another.
STARTS = [[5, 5, 2], [4, 6, 2], [6, 4, 3], [7, 7, 1]]
#: Packets that need an SNR of about 1.
LOUD = {"uplink.packet_bits": 60000, "charging.power_w": 900000}
laws = settings(max_examples=25, deadline=None)


def several(name, access, auvs=3, **changes):
    return load_scenario(
        name, {"auvs.start_cells": STARTS[:auvs], "channel.access": access, **changes}
    )


@pytest.mark.slow
@laws
@given(st.sampled_from(NAMES), st.sampled_from(ACCESS), st.integers(0, 10**6))
def test_one_auv_has_the_band_to_itself(name, access, seed):
    alone = load_scenario(name)
    actions = draw_actions(alone, seed)
    _, expected = play(alone, actions)
    _, found = play(load_scenario(name, {"channel.access": access}), actions)
    for (state, _), (other, _) in zip(expected, found, strict=True):
        for a, b in zip(state, other, strict=True):
            np.testing.assert_array_equal(a, b)


def uplinks(state, events):
    """Of every env the AUVs' cells, nodes heard, and outcomes; AUVs in one cell are alike."""
    parts = (state.cell, events.heard, events.delivered, events.spent_j)
    return [
        sorted(
            (int(cell), int(node), bool(arrived), f"{spent:.9g}")
            for cell, node, arrived, spent in zip(*env, strict=True)
        )
        for env in zip(*parts, strict=True)
    ]


@pytest.mark.slow
@laws
@given(
    st.sampled_from(NAMES),
    st.sampled_from(ACCESS),
    st.booleans(),
    st.integers(0, 10**6),
    st.permutations(range(4)),
)
def test_renumbering_the_auvs_renumbers_the_results(name, access, loud, seed, order):
    changes = {"observation.view_range_m": 400, "reward.credit": "difference"}
    changes |= LOUD if loud and name.endswith("fdd") else {}
    scenario = several(name, access, auvs=4, **changes)
    actions = draw_actions(scenario, seed)
    world, history = play(scenario, actions)
    starts = {"auvs.start_cells": [STARTS[i] for i in order]}
    _, permuted = play(load_scenario(scenario, starts), actions[:, :, order])
    for (state, events), (other, others) in zip(history, permuted, strict=True):
        np.testing.assert_array_equal(state.cell[:, order], other.cell)
        np.testing.assert_array_equal(state.age, other.age)
        np.testing.assert_allclose(state.energy_j, other.energy_j, rtol=1e-9, atol=1e-9)
        seen, others_see = world.observe(state)[:, order], world.observe(other)
        np.testing.assert_allclose(seen, others_see, rtol=1e-9, atol=1e-9)
        if events is not None:
            rewards = world.reward(state, events)[:, order]
            np.testing.assert_allclose(rewards, world.reward(other, others), rtol=1e-9)
            assert uplinks(state, events) == uplinks(other, others)


def sinr(world, before, state, events, env):
    """SNR of every uplink that arrived, in parts of what its packet needs; (receivers,)."""
    link = world.link
    cell, node_cell = state.cell[env], state.node_cell[env]
    auvs = np.flatnonzero(events.delivered[env])
    nodes = events.heard[env, auvs]
    beta = events.beta[env, auvs]
    uplink_s = np.where(world.duplex.num_choices == 1, (1 - beta) * link.slot_s, link.slot_s)
    power_w = events.spent_j[env, auvs] / uplink_s
    offset = link.offset(cell[auvs][:, None], node_cell[nodes][None, :])
    received = power_w / link.power_per_snr_w[offset]
    noise = 1 + received.sum(axis=1) - np.diag(received)
    need = world.scenario.uplink.packet_bits / (uplink_s * link.budget.bandwidth_hz)
    return np.diag(received) / noise / (2**need - 1)


@pytest.mark.slow
@laws
@given(st.booleans(), st.integers(0, 10**6))
def test_under_interference_every_packet_gets_the_snr_it_needs_and_no_more(loud, seed):
    scenario = several("paper/k5-fdd", "interference", auvs=4, **(LOUD if loud else {}))
    world, history = play(scenario, draw_actions(scenario, seed))
    for (before, _), (state, events) in itertools.pairwise(history):
        for env in range(2):
            ratio = sinr(world, before, state, events, env)
            np.testing.assert_allclose(ratio, 1, rtol=1e-6)


@pytest.mark.slow
@laws
@given(st.sampled_from(ACCESS), st.integers(0, 10**6))
def test_no_node_spends_more_than_it_has(access, seed):
    scenario = several("paper/k5-fdd", access, auvs=4, **LOUD)
    _, history = play(scenario, draw_actions(scenario, seed))
    for state, events in history[1:]:
        spent = np.zeros_like(state.energy_j)
        for env, auv in np.ndindex(*events.heard.shape):
            spent[env, events.heard[env, auv]] += events.spent_j[env, auv]
        assert (spent <= events.available_j * (1 + 1e-9)).all()


@pytest.mark.slow
@laws
@given(st.integers(0, 10**6))
def test_exclusive_lets_one_uplink_through_and_collisions_cost_their_energy(seed):
    scenario = several("paper/k5-fdd", "exclusive", auvs=4)
    _, history = play(scenario, draw_actions(scenario, seed))
    collisions = 0
    for _, events in history[1:]:
        senders = (events.spent_j > 0).sum(axis=1)
        assert (events.delivered.sum(axis=1) == (senders == 1)).all()
        collisions += (senders > 1).sum()
    assert collisions > 0


def test_orthogonal_gives_each_auv_its_part_of_the_band():
    for auvs in (1, 2, 4):
        world = World(several("paper/k5-fdd", "orthogonal", auvs=auvs))
        assert world.link.budget.bandwidth_hz == 3000 / auvs
    assert World(several("paper/k5-fdd", "interference")).link.budget.bandwidth_hz == 3000


def crossing(access, stored_j, auvs=3, **changes):
    """Two AUVs that hear nodes 0 and 1, and one more that hears node 2, which has nothing."""
    cells = {"nodes.cells": [[1, 1, 1], [10, 10, 4], [10, 1, 4]], "charging.power_w": 1e-6}
    starts = {"auvs.start_cells": [[2, 2, 1], [9, 9, 4], [10, 2, 4]][:auvs]}
    scenario = load_scenario(
        "paper/k3-fdd", {**cells, **starts, "channel.access": access, **changes}
    )
    world = World(scenario)
    layout = world.grid.encode(np.array(scenario.nodes.cells) - 1)[None]
    state = world.reset(layout)._replace(energy_j=np.array([[*stored_j, 0.0]]))
    actions = np.array([[[0, 0, 0], [1, 1, 1], [0, 2, 2]][:auvs]])
    return world.step(state, actions)[1]


@pytest.mark.parametrize("size", [1, 2, 3, 5, 9])
def test_powers_can_be_met_where_what_each_adds_to_the_others_dies_away(size):
    rng = np.random.default_rng(size)
    coupling = rng.uniform(0, 2 / max(size - 1, 1), (2000, size, size)) * (1 - np.eye(size))
    matrix, right = np.eye(size) - coupling, rng.uniform(0.1, 2.0, (2000, size))
    solution, solvable = positive_solution(np, matrix, right)
    radius = np.abs(np.linalg.eigvals(coupling)).max(-1)
    np.testing.assert_array_equal(solvable[:, 0], radius < 1)
    assert size == 1 or 0.1 < solvable.mean() < 0.9
    met = solvable[:, 0]
    expected = np.linalg.solve(matrix, right[..., None])[..., 0]
    np.testing.assert_allclose(solution[met], expected[met], rtol=1e-8)
    assert (solution[met] > 0).all()


@pytest.mark.parametrize("loud", [{}, {"uplink.packet_bits": 60000}])
def test_an_idle_auv_changes_nothing_under_interference(loud):
    with_it = crossing("interference", (1e9, 1e9), **loud)
    without = crossing("interference", (1e9, 1e9), auvs=2, **loud)
    np.testing.assert_array_equal(with_it.delivered, [[True, True, False]])
    np.testing.assert_allclose(with_it.spent_j[:, :2], without.spent_j, rtol=1e-12)


def test_an_uplink_that_cannot_be_paid_under_interference_silences_the_weaker_one():
    free = crossing("interference", (1e9, 1e9), **{"uplink.packet_bits": 60000})
    alone = crossing("exclusive", (1e9, 0.0), **{"uplink.packet_bits": 60000})
    assert free.spent_j[0, 0] > alone.spent_j[0, 0]
    # Node 0 has enough for the band alone, not for its share of both.
    between = (alone.spent_j[0, 0] + free.spent_j[0, 0]) / 2
    short = crossing("interference", (between, 1e9), **{"uplink.packet_bits": 60000})
    assert short.delivered.sum() == 1


def test_charging_drowns_listening_in_tdd_unless_synchronised():
    def play_tdd(synchronised):
        scenario = several(
            "best/k5-tdd", "interference", auvs=4, **{"duplex.synchronised": synchronised}
        )
        _, history = play(scenario, draw_actions(scenario, 3, slots=100))
        return history[-1][0]

    assert (play_tdd(True).deliveries.sum(axis=1) > play_tdd(False).deliveries.sum(axis=1)).all()
