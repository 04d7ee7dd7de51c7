"""The paper's baselines, held against their descriptions."""

import numpy as np
import pytest
from scipy.stats import chisquare

from iout_marl import InputError, World, evaluate, load_scenario
from iout_marl.policies import BASELINES, POLICIES, Greedy, RandomWalk, RoundRobin, make_baseline
from iout_marl.world import node_codes

#: Below this a uniform draw is no longer believed; seeds are fixed.
P_VALUE = 1e-3
TWO_AUVS = {"auvs.start_cells": [[5, 5, 2], [1, 2, 1]]}


def start(name="paper/k5-fdd", changes=(), envs=1, seed=0):
    scenario = load_scenario(name, changes)
    world = World(scenario, envs)
    rng = np.random.default_rng(seed)
    return world, world.reset(node_codes(scenario, world.grid, [rng] * envs)), rng


def play(policy, world, state, rng, slots):
    """The actions of every slot, (slots, envs, auvs, entries), and the states before them."""
    actions, states = [], []
    for _ in range(slots):
        action = policy.act(world, state, rng)
        actions.append(action)
        states.append(state)
        state, _ = world.step(state, action)
    return np.array(actions), states


def is_uniform(values, size):
    return chisquare(np.bincount(values.ravel(), minlength=size)).pvalue > P_VALUE


@pytest.mark.parametrize("policy", BASELINES.values(), ids=list(BASELINES))
@pytest.mark.parametrize("name", ["paper/k5-fdd", "paper/k3-tdd"])
@pytest.mark.parametrize("changes", [{}, TWO_AUVS], ids=["one-auv", "two-auvs"])
class TestEveryBaseline:
    @pytest.mark.slow
    def test_stays_in_the_action_space(self, policy, name, changes):
        world, state, rng = start(name, changes, envs=7)
        actions, _ = play(policy(), world, state, rng, 50)
        assert actions.shape == (50, 7, world.num_auvs, len(world.action_sizes))
        assert actions.dtype.kind == "i"
        assert (actions >= 0).all()
        assert (actions < world.action_sizes).all()

    @pytest.mark.slow
    def test_draws_from_the_given_stream_alone(self, policy, name, changes):
        np.random.seed(3)  # noqa: NPY002
        first = play(policy(), *start(name, changes, envs=3), 20)[0]
        np.random.seed(4)  # noqa: NPY002
        assert (first == play(policy(), *start(name, changes, envs=3), 20)[0]).all()


def test_names_are_those_of_the_table():
    assert list(BASELINES) == ["random-walk", "round-robin", "greedy", "tour"]
    assert list(POLICIES) == ["return", "pretrained", *BASELINES, "planner"]
    assert all(make_baseline(name).name == name for name in POLICIES)


def test_unknown_name():
    with pytest.raises(InputError, match=r"no policy 'gredy'; did you mean 'greedy'\?"):
        make_baseline("gredy")


def test_random_walk_is_uniform_over_the_action_space():
    world, state, rng = start("paper/k3-fdd", envs=5000)
    action = RandomWalk().act(world, state, rng)[:, 0]
    joint = np.ravel_multi_index(action.T, world.action_sizes)
    assert is_uniform(joint, np.prod(world.action_sizes))


@pytest.mark.parametrize("name", ["paper/k7-fdd", "paper/k7-tdd"])
def test_round_robin_counts_on_whatever_becomes_of_the_uplink(name):
    world, state, rng = start(name, envs=4)
    actions, states = play(RoundRobin(), world, state, rng, 30)
    delivered = states[-1].deliveries.sum()
    assert 0 < delivered < 29 * 4, "all or no uplinks worked: nothing to tell them apart by"
    turns = np.arange(30)[:, None, None] % 7
    assert (actions[..., -1] == turns).all()
    assert (actions[..., 1] == turns).all()


def test_round_robin_moves_uniformly_and_unmasked():
    world, state, rng = start(envs=50)
    actions, states = play(RoundRobin(), world, state, rng, 100)
    assert is_uniform(actions[..., 0], 6)
    cells = np.array([s.cell for s in states])
    inside = world.motion.stays_inside(cells[-1])
    at_edge = ~inside[np.arange(50)[:, None], 0, actions[-1][..., 0]]
    assert at_edge.any(), "no one ever walks into the edge"


def test_round_robins_of_a_fleet_keep_out_of_step():
    world, state, rng = start(changes=TWO_AUVS)
    actions, _ = play(RoundRobin(), world, state, rng, 5)
    first, second = actions[:, 0, :, -1].T
    assert sorted(first) == sorted(second) == [0, 1, 2, 3, 4]
    assert (first != second).all()


RANDOM = {"nodes": {"kind": "random", "count": 5}}


def coordinates(world, cells):
    return world.grid.coordinate_table()[cells].astype(float)


def test_greedy_goes_towards_the_centre_of_gravity_and_never_rests():
    world, state, rng = start(changes=RANDOM, envs=40)
    actions, states = play(Greedy(), world, state, rng, 20)
    for action, before, after in zip(actions, states[:-1], states[1:], strict=False):
        assert (before.cell != after.cell).all(), "at rest"
        centre = coordinates(world, before.node_cell).mean(1)
        reached = np.linalg.norm(coordinates(world, after.cell)[:, 0] - centre, axis=-1)
        others = coordinates(world, world.motion.neighbours(before.cell))[:, 0]
        moves = (world.motion.neighbours(before.cell) != before.cell[..., None])[:, 0]
        best = np.linalg.norm(others - centre[:, None], axis=-1)
        assert (reached == np.where(moves, best, np.inf).min(-1)).all()
        assert action.shape == (40, 1, 3)


def test_greedy_serves_the_nearest_node_on_its_way():
    world, state, rng = start(changes=RANDOM, envs=40)
    actions, states = play(Greedy(), world, state, rng, 20)
    on_the_way = 0
    for action, before in zip(actions, states, strict=True):
        nodes, auv = coordinates(world, before.node_cell), coordinates(world, before.cell)
        away = np.linalg.norm(auv[:, 0] - nodes.mean(1), axis=-1) > 1
        distance = np.linalg.norm(auv - nodes, axis=-1)
        chosen = np.take_along_axis(distance, action[:, 0, -1:], axis=-1)[:, 0]
        assert (chosen[away] == distance.min(-1)[away]).all()
        on_the_way += away.sum()
    assert on_the_way > 20


def test_greedy_serves_a_random_node_at_the_centre():
    # Centre of gravity (2, 2, 1), and the AUV one cell from it.
    changes = {
        "grid.cells": [3, 3, 1],
        "nodes.cells": [[1, 2, 1], [3, 2, 1], [2, 1, 1], [2, 3, 1]],
        "nodes.count": 4,
        "auvs.start_cells": [[2, 1, 1]],
    }
    world, state, rng = start(changes=changes, envs=2000)
    actions, _ = play(Greedy(), world, state, rng, 1)
    assert is_uniform(actions[..., -1], 4)


@pytest.mark.parametrize("policy", [RoundRobin, Greedy])
def test_node_charged_is_the_node_heard(policy):
    world, state, rng = start("paper/k10-fdd", envs=20)
    actions, _ = play(policy(), world, state, rng, 30)
    assert (actions[..., 1] == actions[..., 2]).all()


#: Mean AoI for K = 3, 5, 7, 10 in the TDD world as others estimated it, by 60 episodes.
ESTIMATES = {
    "random-walk": [13.7, 16.3, 21.4, 26.4],
    "round-robin": [12.2, 14.8, 19.9, 24.1],
    "greedy": [6.6, 9.2, 14.7, 22.2],
}


@pytest.mark.slow
@pytest.mark.parametrize(("column", "nodes"), list(enumerate([3, 5, 7, 10])))
def test_agrees_with_independent_estimates(column, nodes):
    found = [evaluate(f"paper/k{nodes}-tdd", p, 200).metrics["mean_aoi"].mean for p in ESTIMATES]
    assert found == pytest.approx([values[column] for values in ESTIMATES.values()], rel=0.2)
    assert found == sorted(found, reverse=True)
