"""The planner: never worse than what it starts from, the same by the same seed, and optimal
where every sequence of actions can be tried."""

import itertools

import numpy as np
import pytest

from iout_marl import InputError, World, evaluate, load_scenario
from iout_marl.evaluation import play
from iout_marl.policies import Budget, PlannerPolicy, make_baseline
from iout_marl.policies.beam import BeamSearch, Weights
from iout_marl.policies.search import Planner
from iout_marl.policies.simulator import Simulator, rows
from iout_marl.world import node_codes

SHORT = {"episode.duration_s": 300}
TWO = {"auvs.count": 2, "channel.access": "interference"}
NOBODY = {"auvs.idle_choices": True}
WORLDS = [
    ("best/k5-fdd", {}),
    ("best/k5-tdd", {}),
    ("best/k5-fdd", TWO),
    ("best/k5-tdd", TWO | NOBODY),
]
EVERY_WORLD = pytest.mark.parametrize(("name", "changes"), WORLDS, ids=str)


def start(name, changes=()):
    scenario = load_scenario(name, changes)
    world = World(scenario)
    return world, world.reset(node_codes(scenario, world.grid, [np.random.default_rng(0)]))


def age_sum(world, state, actions):
    for action in actions:
        state, _ = world.step(state, action[None])
    return float(state.age_sum[0])


class Script:
    """Plays given actions, slot by slot."""

    name = "script"

    def __init__(self, actions):
        self.actions = actions

    def act(self, world, state, rng):
        return self.actions[int(state.slot[0])][None]


@EVERY_WORLD
class TestPlans:
    @pytest.mark.slow
    def test_are_what_the_world_makes_of_valid_actions(self, name, changes):
        world, state = start(name, {**SHORT, **changes})
        plan = Planner(world.scenario, searches=True).plan(state, Budget(rounds=2))
        assert plan.actions.shape == (world.num_slots, world.num_auvs, len(world.action_sizes))
        assert ((plan.actions >= 0) & (plan.actions < world.action_sizes)).all()
        assert plan.age_sum == pytest.approx(age_sum(world, state, plan.actions))

    @pytest.mark.slow
    def test_get_no_worse_by_searching_longer(self, name, changes):
        world, state = start(name, {**SHORT, **changes})
        tour = Planner(world.scenario, searches=False).plan(state).age_sum
        planner = Planner(world.scenario, searches=True)
        ages = [planner.plan(state, Budget(rounds=rounds)).age_sum for rounds in (0, 1, 3)]
        assert ages == sorted(ages, reverse=True)
        assert ages[-1] < ages[0] <= tour

    @pytest.mark.slow
    def test_are_the_same_by_the_same_seed(self, name, changes):
        world, state = start(name, {**SHORT, **changes})
        plans = [
            Planner(world.scenario, searches=True, seed=seed).plan(state, Budget(rounds=2))
            for seed in (1, 1, 2)
        ]
        assert np.array_equal(plans[0].actions, plans[1].actions)
        assert not np.array_equal(plans[0].actions, plans[2].actions)

    @pytest.mark.slow
    def test_are_no_worse_than_the_policies_they_start_from(self, name, changes):
        world, state = start(name, {**SHORT, **changes})
        good = Planner(world.scenario, searches=True).plan(state, Budget(rounds=2))
        poor = Planner(world.scenario, searches=True)
        poor = poor.plan(state, Budget(rounds=0), [make_baseline("random-walk")])
        assert good.age_sum < poor.age_sum
        warm = PlannerPolicy(Budget(rounds=0), warm=[Script(good.actions)])
        (*_, (last, _)) = play(World(world.scenario), warm)
        assert float(last.age_sum[0]) <= good.age_sum + 1e-9

    @pytest.mark.slow
    def test_are_no_worse_than_a_policy_that_leaves_nodes_alone(self, name, changes):
        """Whose choice of nobody is nobody in plans, too, in which nodes have another order."""
        world, state = start(name, {**SHORT, **changes, **NOBODY})
        good = Planner(world.scenario, searches=True).plan(state, Budget(rounds=1)).actions.copy()
        good[::3, :, 1:] = world.num_nodes
        planner = Planner(world.scenario, searches=False)
        idle = np.full_like(good, world.num_nodes)
        idle[..., 0] = 0
        planner._follow = lambda *_: idle  # in place of a tour, which would be better
        found = planner.plan(state, warm=[Script(good)])
        assert found.age_sum == pytest.approx(age_sum(world, state, found.actions))
        assert np.array_equal(found.actions, good)

    @pytest.mark.slow
    def test_known_plans_stay_in_the_beam(self, name, changes):
        world, state = start(name, {**SHORT, **changes})
        good = Planner(world.scenario, searches=True).plan(state, Budget(rounds=1))
        simulator = Simulator(world.scenario)
        # So narrow a beam finds nothing of the kind by itself.
        beam = BeamSearch(simulator, episodes=1, choices=1)
        route = np.tile(state.cell, (world.num_slots, 1))
        weights, rng = Weights.usual(simulator), np.random.default_rng(0)
        without = beam.search(state, route, weights, rng)
        found = beam.search(state, route, weights, rng, good.actions)
        assert age_sum(world, state, found) <= good.age_sum + 1e-9
        assert age_sum(world, state, without) > good.age_sum


@pytest.mark.slow
@pytest.mark.parametrize("duplex", ["fdd", "tdd"])
@pytest.mark.parametrize("layout", [[[1, 1, 1], [3, 3, 1]], [[1, 2, 1], [2, 2, 1]]], ids=str)
@pytest.mark.parametrize("distance_m", [100, 400])
def test_reach_the_optimum_of_tiny_worlds(duplex, layout, distance_m):
    num_slots = 6 if duplex == "tdd" else 5
    changes = {
        "grid.cells": [3, 3, 1],
        "grid.spacing_m": distance_m,
        "nodes.cells": layout,
        "nodes.count": 2,
        "auvs.start_cells": [[2, 1, 1]],
        # A slot is the time for one move at 4 m/s.
        "episode.duration_s": num_slots * distance_m / 4,
    }
    world, state = start(f"best/k3-{duplex}", changes)
    assert world.num_slots == num_slots
    plan = Planner(world.scenario, searches=True).plan(state, Budget(rounds=2))
    assert plan.age_sum == pytest.approx(optimum(world, state))


def optimum(world, state):
    """The least sum of ages over all sequences of actions; states that are alike are one."""
    # Up and down lead out of a grid of one layer: both are the same as any other way to stay.
    every = list(itertools.product(*(range(size) for size in world.action_sizes)))
    for _ in range(world.num_slots):
        count = len(state.slot)
        action = np.tile(np.array(every)[:, None], (count, 1, 1))
        state = rows(state, np.repeat(np.arange(count), len(every)))
        state, _ = World(world.scenario, count * len(every)).step(state, action)
        same = np.concatenate((state.cell, state.age, state.energy_j.round(9)), axis=1)
        order = np.lexsort((state.age_sum, *same.T))
        differs = (same[order][1:] != same[order][:-1]).any(axis=1)
        state = rows(state, order[np.append(True, differs)])
    return float(state.age_sum.min())


class TestBudgets:
    def test_of_seconds_are_spent_and_hardly_more(self, monkeypatch):
        now = itertools.count()
        monkeypatch.setattr("iout_marl.policies.search.time.monotonic", lambda: next(now))
        assert list(Budget(seconds=3.5).turns()) == [0, 1, 2]
        assert list(Budget(seconds=0).turns()) == []

    def test_of_rounds_do_not_depend_on_the_clock(self, monkeypatch):
        now = itertools.count(0, 1000)
        monkeypatch.setattr("iout_marl.policies.search.time.monotonic", lambda: next(now))
        assert list(Budget(rounds=2).turns()) == [0, 1]

    @pytest.mark.slow
    def test_are_shared_by_layouts(self, monkeypatch):
        budgets = []

        def plan(self, state, budget, warm):
            budgets.append(budget)
            return original(self, state, Budget(rounds=0), warm)

        original = Planner.plan
        monkeypatch.setattr(Planner, "plan", plan)
        nodes = {"kind": "random", "count": 3}
        scenario = load_scenario("best/k3-fdd", {**SHORT, "nodes": nodes})
        evaluate(scenario, PlannerPolicy(Budget(rounds=7)), 3)
        evaluate(scenario, PlannerPolicy(Budget(seconds=6)), 3)
        evaluate("best/k3-fdd", PlannerPolicy(Budget(rounds=7)), 3)
        assert budgets == [Budget(rounds=2)] * 3 + [Budget(seconds=2)] * 3 + [Budget(rounds=7)]

    @pytest.mark.parametrize(
        ("settings", "message"),
        [
            ({}, "either rounds or seconds"),
            ({"rounds": 1, "seconds": 1}, "either rounds or seconds"),
            ({"rounds": -1}, "rounds must not be negative, not -1"),
            ({"seconds": -1.5}, "seconds must be 0 or more, not -1.5"),
            ({"seconds": float("nan")}, "seconds must be 0 or more, not nan"),
        ],
    )
    def test_that_make_no_sense(self, settings, message):
        with pytest.raises(InputError, match=message):
            Budget(**settings)
