"""Tours and the planner: their shares, their ways, and what they are worth."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from iout_marl import World, evaluate, load_scenario
from iout_marl.bounds import delivery_bound
from iout_marl.evaluation import play
from iout_marl.policies import Budget, PlannerPolicy, Tour, make_baseline, search
from iout_marl.policies.routes import (
    Gait,
    assign_nodes,
    moves_between,
    nearest_neighbour_order,
    tour_order,
    tours,
    walk,
)
from iout_marl.world import node_codes

pytestmark = pytest.mark.slow

OTHERS = ("random-walk", "round-robin", "greedy")
BY_EPISODE = {"nodes": {"kind": "random", "count": 6}}
SHORT = {"episode.duration_s": 500}
FIRST = Budget(rounds=0)


def points(least=1, most=14):
    cells = st.integers(0, 9).map(float)
    return st.integers(least, most).flatmap(lambda n: arrays(float, (n, 3), elements=cells))


def narrow(monkeypatch):
    """For plans of which it is not asked how good they are: a narrow search."""
    monkeypatch.setattr(search, "FIRST_SEARCH", (24, 1))
    monkeypatch.setattr(search, "ROUND_SEARCH", (48, 3))


def mean_age(scenario, policy, episodes=1):
    return evaluate(scenario, policy, episodes).metrics["mean_aoi"].mean


class TestShares:
    @given(points(), points(1, 6))
    @settings(max_examples=60, deadline=None)
    def test_hold_every_node_once_and_are_balanced(self, nodes, starts):
        shares = assign_nodes(nodes, starts)
        assert len(shares) == len(starts)
        assert sorted(np.concatenate(shares)) == list(range(len(nodes)))
        sizes = [len(share) for share in shares]
        assert max(sizes) - min(sizes) <= 1

    def test_are_near_one_another_and_near_their_auv(self):
        west, east = np.zeros((3, 3)), np.zeros((3, 3))
        west[:, 1], east[:, 1], east[:, 0] = range(3), range(3), 9
        starts = np.array([[8.0, 0, 0], [1, 0, 0]])
        first, second = assign_nodes(np.concatenate([west, east]), starts)
        assert (first.tolist(), second.tolist()) == ([3, 4, 5], [0, 1, 2])


def length(order, moves):
    return moves[order, np.roll(order, -1)].sum()


class TestTours:
    @given(points())
    @settings(max_examples=60, deadline=None)
    def test_are_no_longer_than_those_of_the_nearest_neighbour(self, nodes):
        moves, order = moves_between(nodes, nodes), tour_order(nodes)
        assert sorted(order) == list(range(len(nodes)))
        assert length(order, moves) <= length(nearest_neighbour_order(moves), moves)

    def test_are_close_to_the_shortest(self):
        rng = np.random.default_rng(0)
        excess = []
        for _ in range(20):
            nodes = rng.integers(0, 10, (7, 3)).astype(float)
            moves = moves_between(nodes, nodes)
            every = (np.array((0, *rest)) for rest in itertools.permutations(range(1, 7)))
            shortest = min(length(order, moves) for order in every)
            excess.append(length(tour_order(nodes), moves) / shortest - 1)
        assert np.mean(excess) < 0.03

    @pytest.mark.parametrize("may_rest", [True, False])
    @pytest.mark.parametrize("shape", [(10, 10, 4), (1, 1, 1), (1, 3, 1)])
    def test_go_from_cell_to_cell_in_the_grid(self, may_rest, shape):
        rng = np.random.default_rng(1)
        nodes = rng.integers(0, shape, (5, 3))
        starts = rng.integers(0, shape, (2, 3))
        routes = tours(nodes, starts, 30, shape, Gait(may_rest))
        assert ((routes >= 0) & (routes < shape)).all()
        before = np.tile(starts, (len(routes), 1, 1, 1))
        moved = np.abs(np.diff(routes, axis=1, prepend=before)).sum(-1)
        assert (moved <= 1).all()
        if not may_rest and max(shape) > 1:
            assert (moved == 1).all()

    def test_of_full_reach_touch_every_node(self):
        nodes = np.array([[0, 0, 0], [4, 0, 0], [4, 4, 1], [0, 4, 1]])
        starts = np.array([[2, 2, 0]])
        route = tours(nodes, starts, 40, (5, 5, 2), Gait(False))[-1, :, 0].tolist()
        assert all(node in route for node in nodes.tolist())


#: Mean AoI at most, of a tour and of the planner; the paper's 10 nodes, the fleet on one band.
GOALS = [
    ("fdd", 1, 7.0, 6.2),
    ("fdd", 2, 3.3, 3.2),
    ("fdd", 3, 2.3, 2.3),
    ("tdd", 1, 10.5, 9.0),
    ("tdd", 2, 8.0, 6.5),
    ("tdd", 3, 6.5, 4.6),
]


@pytest.mark.parametrize(("duplex", "auvs", "tour", "planner"), GOALS)
def test_are_strong(duplex, auvs, tour, planner, monkeypatch):
    # A sixth of what it usually plays side by side is enough for these.
    monkeypatch.setattr(search, "ROUND_SEARCH", (768, 3))
    changes = {"auvs.count": auvs, "channel.access": "interference"}
    scenario = load_scenario(f"best/k10-{duplex}", changes)
    ages = mean_age(scenario, "tour"), mean_age(scenario, PlannerPolicy(Budget(rounds=1)))
    assert ages[0] < tour
    assert delivery_bound(scenario) <= ages[1] < planner
    assert ages[1] <= ages[0] < 0.7 * min(mean_age(scenario, other, 20) for other in OTHERS)


@pytest.mark.parametrize("access", ["orthogonal", "interference", "exclusive"])
@pytest.mark.parametrize("name", ["paper/k5-fdd", "paper/k5-tdd", "best/k5-tdd"])
def test_are_ahead_whatever_the_access(name, access):
    scenario = load_scenario(name, {"auvs.count": 2, "channel.access": access})
    tour = mean_age(scenario, "tour")
    assert mean_age(scenario, PlannerPolicy(FIRST)) <= tour
    assert tour < 0.9 * min(mean_age(scenario, other, 20) for other in OTHERS)


@pytest.mark.parametrize("policy", [Tour, lambda: PlannerPolicy(FIRST)], ids=["tour", "planner"])
@pytest.mark.parametrize("name", ["paper/k5-fdd", "best/k5-tdd"])
def test_several_take_turns_where_one_may_send(name, policy):
    changes = {"auvs.count": 3, "channel.access": "exclusive"}
    scenario = load_scenario(name, changes)
    states = play(World(scenario), policy())
    delivered = [int(events.delivered.sum()) for _, events in states if events is not None]
    assert np.mean(delivered) > 0.7
    assert max(delivered) == 1


@pytest.mark.parametrize(
    "policy", [Tour, lambda: PlannerPolicy(Budget(rounds=1))], ids=["tour", "planner"]
)
@pytest.mark.parametrize("name", ["paper/k3-fdd", "paper/k3-tdd", "best/k3-tdd"])
@pytest.mark.parametrize("motion", ["six", "hover"])
@pytest.mark.parametrize(
    "changes",
    [
        {"auvs.count": 5},
        {"auvs.count": 5, "channel.access": "exclusive"},
        {"auvs.count": 5, "channel.access": "interference"},
        {"nodes.count": 1},
        {"nodes.count": 1, "auvs.count": 3, "channel.access": "interference"},
        {
            "grid.cells": [1, 1, 1],
            "nodes.cells": [[1, 1, 1]],
            "nodes.count": 1,
            "auvs.start_cells": [[1, 1, 1]],
        },
        {
            "grid.cells": [2, 1, 1],
            "nodes.cells": [[1, 1, 1], [2, 1, 1]],
            "nodes.count": 2,
            "auvs.start_cells": [[1, 1, 1], [2, 1, 1]],
        },
        {"episode.duration_s": 25},
        {"auvs.count": 2, "observation.view_range_m": 200, "reward.credit": "difference"},
    ],
    ids=str,
)
def test_plays_any_world(name, motion, changes, policy, monkeypatch):
    narrow(monkeypatch)
    scenario = load_scenario(name, {**SHORT, "auvs.motion": motion, **changes})
    world = World(scenario)
    *_, (state, _) = play(world, policy())
    assert int(state.slot[0]) == world.num_slots
    if world.num_slots > 1:
        assert state.deliveries.sum() >= 1


@pytest.mark.parametrize("name", ["best/k10-fdd", "best/k10-tdd"])
class TestLayouts:
    def scenario(self, name, auvs=2):
        return load_scenario(name, {**SHORT, **BY_EPISODE, "auvs.count": auvs})

    def test_a_batch_is_as_its_environments_alone(self, name, monkeypatch):
        narrow(monkeypatch)
        scenario = self.scenario(name)
        together = evaluate(scenario, PlannerPolicy(Budget(rounds=4)), 4).samples["mean_aoi"]
        policy = PlannerPolicy(Budget(rounds=1))
        alone = [evaluate(scenario, policy, 1, seed).samples["mean_aoi"][0] for seed in range(4)]
        assert together == pytest.approx(alone, abs=1e-9)
        assert len(set(alone)) == 4

    def test_the_order_of_nodes_does_not_matter(self, name, monkeypatch):
        narrow(monkeypatch)
        world = World(self.scenario(name, auvs=1), 2)
        codes = node_codes(world.scenario, world.grid, [np.random.default_rng(3)])[0]
        order = np.random.default_rng(4).permutation(len(codes))
        policy, rng = PlannerPolicy(Budget(rounds=2)), np.random.default_rng(0)
        state = world.reset(np.stack([codes, codes[order]]))
        for _ in range(world.num_slots):
            action = policy.act(world, state, rng)
            assert (action[0, :, 0] == action[1, :, 0]).all()
            assert (action[0, :, 1:] == order[action[1, :, 1:]]).all()
            state, _ = world.step(state, action)

    def test_two_worlds_in_turn(self, name):
        scenario = self.scenario(name)
        policy = PlannerPolicy(FIRST)
        expected = [evaluate(scenario, policy, 1, seed).samples["mean_aoi"][0] for seed in (5, 6)]
        worlds, policy = [World(scenario), World(scenario)], PlannerPolicy(FIRST)
        episodes = [play(w, policy, seed) for w, seed in zip(worlds, (5, 6), strict=True)]
        *_, last = zip(*episodes, strict=True)
        found = [w.metrics(s)["mean_aoi"][0] for w, (s, _) in zip(worlds, last, strict=True)]
        assert found == pytest.approx(expected, abs=1e-9)

    def test_goes_on_from_a_state_that_it_did_not_foresee(self, name):
        scenario = self.scenario(name)
        world, policy, rng = World(scenario, 3), PlannerPolicy(FIRST), np.random.default_rng(0)
        streams = [np.random.default_rng(i) for i in range(3)]
        state = world.reset(node_codes(scenario, world.grid, streams))
        for slot in range(world.num_slots):
            walks = slot < 10
            actor = make_baseline("random-walk") if walks else policy
            state, _ = world.step(state, actor.act(world, state, rng))
            if walks:
                deliveries = state.deliveries
        assert (state.deliveries.sum(-1) > deliveries.sum(-1) + 5).all()


class TestGaits:
    """Moves that take several slots, or cover several cells in one."""

    def test_a_walk_waits_until_its_moves_are_over(self):
        gait = Gait(True, np.array([3, 2, 1]))
        stops = np.array([[[0, 0, 0], [2, 1, 1]]])
        cells = walk(np.array([[0, 0, 0]]), stops, 12, (5, 5, 5), gait)[:, 0].tolist()
        # Three slots for each of two moves along x, two for one along y, one along z; then back.
        assert cells[:6] == [[1, 0, 0]] * 3 + [[2, 0, 0]] * 3
        assert cells[6:9] == [[2, 1, 0]] * 2 + [[2, 1, 1]]
        assert cells[9:] == [[1, 1, 1]] * 3

    def test_a_walk_over_several_cells_comes_as_near_as_it_can(self):
        gait = Gait(True, np.ones(3, dtype=int), np.array([4, 4, 1]))
        stops = np.array([[[10, 0, 0], [0, 0, 0]]])
        cells = walk(np.array([[1, 0, 0]]), stops, 6, (12, 12, 1), gait)[:, 0, 0].tolist()
        assert set(cells) <= {1, 5, 9}
        assert {1, 9} <= set(cells)

    def test_a_walk_begins_when_its_auv_has_arrived(self):
        stops = np.array([[[4, 0, 0]]])
        cells = walk(np.array([[0, 0, 0]]), stops, 4, (5, 1, 1), Gait(True), np.array([2]))
        assert cells[:, 0, 0].tolist() == [0, 0, 1, 2]
