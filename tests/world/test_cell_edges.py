"""Cells that are no cubes, and the distance within a cell."""

import math

import numpy as np
import pytest

from iout_marl import World, evaluate, iout_v0, load_scenario
from iout_marl.core.box import mean_distance_in_box
from iout_marl.core.grid import Grid
from iout_marl.envs import AUVVectorEnv
from iout_marl.policies import make_baseline
from iout_marl.world import node_codes
from trainers.training import train

FLAT = {"grid.spacing_m": [90, 120, 30], "auvs.motion": "hover"}
MEAN = {"grid.own_cell_distance": "mean"}
SHORT = {"episode.duration_s": 600}
#: Mean distances between two points of a cube (Robbins), of a square and of a line.
CUBE = (
    4 / 105
    + 17 * math.sqrt(2) / 105
    - 2 * math.sqrt(3) / 35
    + math.log(1 + math.sqrt(2)) / 5
    + 2 * math.log(2 + math.sqrt(3)) / 5
    - math.pi / 15
)
SQUARE = (2 + math.sqrt(2) + 5 * math.log(1 + math.sqrt(2))) / 15


def start(name, changes):
    world = World(load_scenario(name, changes))
    cells = node_codes(world.scenario, world.grid, [np.random.default_rng(0)])
    return world, world.reset(cells)


@pytest.mark.parametrize(
    ("edges", "mean"),
    [((1, 1, 1), CUBE), ((100, 100, 100), 100 * CUBE), ((7, 7, 0), 7 * SQUARE), ((0, 3, 0), 1)],
)
def test_mean_distance_in_a_box_has_its_constants(edges, mean):
    assert mean_distance_in_box(edges) == pytest.approx(mean, rel=1e-13)
    assert pytest.approx(0.661707182) == CUBE


@pytest.mark.parametrize("edges", [(100, 100, 20), (3, 60, 8), (1, 1, 1e-4), (1e-12, 1e12, 5)])
def test_mean_distance_in_a_box_is_that_of_drawn_points(edges):
    points = np.random.default_rng(1).random((2, 200_000, 3)) * edges
    distances = np.linalg.norm(points[0] - points[1], axis=-1)
    error = distances.std() / math.sqrt(len(distances))
    mean = mean_distance_in_box(edges)
    assert abs(distances.mean() - mean) < 4 * error
    assert mean_distance_in_box(edges[::-1]) == pytest.approx(mean, rel=1e-14)


@pytest.mark.parametrize("name", ["paper/k3-fdd", "multi/m2-k10-tdd"])
def test_three_equal_edges_are_one(name):
    scenario = load_scenario(name)
    edge = scenario.grid.spacing_m
    other = load_scenario(name, {"grid.spacing_m": [edge] * 3, "grid.own_cell_distance": "zero"})
    assert other == scenario
    assert (other.hash, other.world_hash) == (scenario.hash, scenario.world_hash)
    for changes in ({"grid.spacing_m": [edge, edge, edge + 1]}, MEAN):
        changed = load_scenario(name, changes)
        assert changed.hash != scenario.hash
        assert changed.world_hash != scenario.world_hash
    assert load_scenario(changed.model_dump()) == changed


def test_distances_are_those_between_centres():
    grid = Grid((3, 4, 2), (90.0, 120.0, 30.0))
    cells = grid.all_coordinates()
    codes = grid.encode(cells)
    found = grid.offset_distances_m(5.0)[codes[:, None] - codes + grid.offset_origin]
    centres = cells * grid.edges_m
    expected = np.linalg.norm(centres[:, None] - centres, axis=-1)
    assert found == pytest.approx(np.where(expected > 0, expected, 5.0), rel=1e-15)
    # What lies equally far in cubes does so to the last bit.
    assert np.array_equal(
        Grid((3, 4, 2), (0.1, 0.1, 0.1)).offset_distances_m(),
        Grid((3, 4, 2)).offset_distances() * 0.1,
    )


def test_a_slot_is_the_time_for_the_longest_edge():
    scenario = load_scenario("paper/k3-fdd", FLAT)
    assert scenario.slot_s == 120 / scenario.auvs.speed_m_per_s


def test_layers_cut_in_three_leave_what_happens_between_their_centres():
    """Only the layers become finer: slots and links between the same places are as they were."""
    coarse = {"grid.spacing_m": [100, 100, 60], "auvs.motion": "hover"}
    scenario = load_scenario("paper/k3-fdd", coarse)

    def finer(cell):
        x, y, z = cell
        return [x, y, 3 * z - 1]

    columns, rows, layers = scenario.grid.cells
    fine = {
        **coarse,
        "grid.spacing_m": [100, 100, 20],
        "grid.cells": [columns, rows, 3 * layers],
        "nodes.cells": [finer(cell) for cell in scenario.nodes.cells],
        "nodes.count": scenario.num_nodes,
        "auvs.start_cells": [finer(cell) for cell in scenario.auvs.start_cells],
    }
    worlds, states = zip(start(scenario, {}), start("paper/k3-fdd", fine), strict=True)
    assert worlds[0].link.slot_s == worlds[1].link.slot_s
    rng = np.random.default_rng(3)
    for _ in range(worlds[0].num_slots):
        # In the layer: +x, −x, +y, −y, or at rest.
        action = [[[rng.choice([0, 1, 2, 3, 6]), *rng.integers(0, 3, 2)]]]
        pairs = zip(worlds, states, strict=True)
        states = [world.step(state, np.array(action))[0] for world, state in pairs]
    assert np.array_equal(states[0].age, states[1].age)
    assert states[0].energy_j == pytest.approx(states[1].energy_j, rel=1e-12)
    assert states[0].deliveries.sum() > 0


@pytest.mark.parametrize("spacing_m", [100, [90, 120, 30]])
def test_within_a_cell_the_distance_is_zero_or_the_mean(spacing_m):
    tables = {}
    for kind in ("zero", "mean"):
        changes = {"grid.spacing_m": spacing_m, "grid.own_cell_distance": kind}
        world = World(load_scenario("paper/k3-fdd", changes))
        tables[kind], own = world.link, world.grid.offset_origin
    zero, mean = tables["zero"], tables["mean"]
    own_m = mean_distance_in_box(world.grid.edges_m)
    assert (zero.distance_m[own], mean.distance_m[own]) == (0, own_m)
    assert mean.way_m[own] == 0
    # No entry, not even one that no pair of cells has, is nearer or harvests more.
    harvest_w = mean.budget.harvested_power_w(np.append(own_m, min(world.grid.edges_m)))
    assert mean.harvested_w.max() == pytest.approx(harvest_w.max())
    elsewhere = zero.distance_m > 0
    for name in ("distance_m", "harvested_w", "power_per_snr_w", "slot_uplink_j"):
        assert np.array_equal(getattr(zero, name)[elsewhere], getattr(mean, name)[elsewhere])
    assert mean.slot_uplink_j[own] > zero.slot_uplink_j[own]
    assert mean.harvested_w[own] < zero.harvested_w[own]


def test_in_sonar_a_cell_of_its_mean_distance_harvests_less_than_is_emitted():
    watts = {}
    for kind in ("zero", "mean"):
        changes = {"channel": {"kind": "sonar"}, "grid.own_cell_distance": kind}
        scenario = load_scenario("paper/k3-fdd", changes)
        watts[kind] = World(scenario).link.harvested_w.max()
        emitted_w = scenario.charging.power_w * scenario.charging.efficiency
    assert watts["zero"] > emitted_w > watts["mean"] > 0


def test_an_auv_at_rest_covers_no_distance_and_dives_are_short():
    changes = {**FLAT, **MEAN}
    found = evaluate("paper/k3-fdd", "random-walk", 2, 1, overrides=changes, breakdown=True)
    world = World(load_scenario("paper/k3-fdd", changes), 2)
    state = world.reset(node_codes(world.scenario, world.grid, [np.random.default_rng(0)] * 2))
    assert world.link.at(world.link.way_m, world.link.offset(state.cell, state.cell)).max() == 0
    columns = found.breakdown.auvs
    per_move = columns["distance_m"] / columns["moving_slots"]
    assert ((per_move > 30) & (per_move < 120)).all()


def test_greedy_takes_the_nearest_node_and_way_in_metres():
    """Three layers are nearer than one cell aside."""
    changes = {
        "grid.cells": [7, 1, 7],
        "grid.spacing_m": [100, 100, 10],
        "nodes.cells": [[2, 1, 1], [1, 1, 7], [7, 1, 1], [7, 1, 7]],
        "nodes.count": None,
        "auvs.start_cells": [[1, 1, 4]],
    }
    world, state = start("paper/k3-fdd", changes)
    action = make_baseline("greedy").act(world, state, np.random.default_rng(0))
    assert action[0, 0].tolist() == [0, 1, 1]


def test_a_single_environment_is_that_of_the_batch():
    changes = {**FLAT, **MEAN, **SHORT, "auvs.count": 2, "observation.view_range_m": 100}
    world, state = start("paper/k3-tdd", changes)
    env = iout_v0.parallel_env("paper/k3-tdd", overrides=changes)
    env.reset(seed=0)
    rng = np.random.default_rng(2)
    while env.agents:
        action = rng.integers(0, world.action_sizes, (2, len(world.action_sizes)))
        seen, rewards, *_ = env.step(dict(zip(env.agents, action, strict=True)))
        state, events = world.step(state, action[None])
        assert list(rewards.values()) == pytest.approx(world.reward(state, events)[0])
        assert np.array(list(seen.values())) == pytest.approx(
            world.observe(state)[0].astype(np.float32)
        )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["best/k3-tdd", "multi/m2-k10-fdd"])
def test_baselines_and_the_planner_play_it(name):
    greedy, tour, planner = (
        evaluate(name, policy, 2, overrides={**FLAT, **MEAN, **SHORT}).metrics["mean_aoi"].mean
        for policy in ("greedy", "tour", "planner")
    )
    assert planner <= tour < greedy


def test_batches_of_environments_and_trainings_have_it(tmp_path):
    changes = {**FLAT, **MEAN, **SHORT, "training.steps": 64, "training.environments": 2}
    changes |= {"training.rollout_slots": 16, "training.minibatches": 2}
    scenario = load_scenario("paper/k3-fdd", changes)
    vector = AUVVectorEnv(scenario, num_envs=3)
    vector.reset(seed=1)
    observation, *_ = vector.step(vector.action_space.sample())
    assert vector.observation_space.contains(observation)
    outcome = train(scenario, tmp_path / "run", evaluation_episodes=1)
    assert outcome is not None
    assert evaluate(scenario, str(tmp_path / "run"), 1).metrics["mean_aoi"].mean >= 1
