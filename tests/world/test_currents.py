"""Currents: what they are, what moves cost in them, and where AUVs go that cannot make good."""

import gymnasium
import numpy as np
import pytest
import torch
from batteries import BATTERY
from oracle import Oracle

from iout_marl import InputError, World, evaluate, iout_v0, load_scenario, parts
from iout_marl.bounds import bound
from iout_marl.core.grid import Grid
from iout_marl.envs.episodes import EpisodeBatch
from iout_marl.parts.current.base import positions_m
from iout_marl.physics import propulsion_power_w
from iout_marl.policies import Budget, PlannerPolicy
from iout_marl.render import Snapshot, as_text
from iout_marl.replay import Recording
from iout_marl.replay.page import render_page
from iout_marl.replay.recorder import record_policy
from iout_marl.tracing.unrolled import UnrolledSlot, numbers
from iout_marl.world import node_codes
from trainers import Trainer

HULL = (BATTERY["drag_area_m2"], BATTERY["drag_coefficient"], BATTERY["propulsion_efficiency"])
MOTOR = {**BATTERY, "capacity_j": 1e7, "initial_share": 1.0, "max_speed_m_per_s": 5.0}
HOVER = {"auvs.motion": "hover", "auvs.idle_choices": True}
#: Directions of HOVER.
RIGHT, LEFT, AHEAD, BACK, DOWN, UP, STAY = range(7)


def uniform(speed, toward_deg=90.0):
    return {"kind": "uniform", "speed_m_per_s": speed, "toward_deg": toward_deg}


def make(current, num_envs=1, vehicle=MOTOR, **changes):
    base = {"auvs.start_cells": [[3, 3, 1]], **HOVER, "vehicle": vehicle, "current": current}
    return World(load_scenario("paper/k3-fdd", {**base, **changes}), num_envs)


def frames(current, **changes):
    scenario = make(current, **changes).scenario
    return scenario, scenario.current.part.frames(scenario)


def step(world, direction, state=None):
    """Of an AUV that names nobody: the state after it, its cell, and what its propulsion took."""
    before = world.reset(seed=0) if state is None else state
    nobody = world.num_nodes
    after, events = world.step(before, np.array([[[direction, nobody, nobody]]]))
    taken_j = (after.propulsion_j - before.propulsion_j)[0, 0]
    cell = (world.grid.coordinate_table()[after.cell[0, 0]] + 1).tolist()
    return after, cell, taken_j, events


# What they are.


@pytest.mark.parametrize(
    ("toward_deg", "x", "y"),
    [(0, 0, 1), (90, 1, 0), (180, 0, -1), (270, -1, 0), (45, 0.5**0.5, 0.5**0.5)],
)
def test_directions_are_clockwise_from_y(toward_deg, x, y):
    _, found = frames(uniform(2.0, float(toward_deg)))
    assert found.is_steady
    assert found.field(0) == pytest.approx(np.tile([2.0 * x, 2.0 * y], (len(found.field(0)), 1)))


def test_a_vortex_has_its_analytic_velocity_and_rests_in_its_centre():
    circulation, core = 900.0, 120.0
    vortex = {"kind": "vortex", "circulation_m2_per_s": circulation, "core_radius_m": core}
    scenario, found = frames({**vortex, "center_m": [200.0, 100.0]})
    offset = positions_m(scenario)[:, :2] - [200.0, 100.0]
    r = np.hypot(*offset.T)
    away = r > 0
    assert (~away).any()
    assert not found.field(0)[~away].any()
    # Of the tangent: against the clock with x to the right and y ahead.
    tangent = np.stack([-offset[:, 1], offset[:, 0]], axis=-1)[away] / r[away, None]
    along = (found.field(0)[away] * tangent).sum(-1)
    expected = circulation / (2 * np.pi * r[away]) * (1 - np.exp(-((r[away] / core) ** 2)))
    assert along == pytest.approx(expected, rel=1e-12)
    assert np.linalg.norm(found.field(0)[away], axis=-1) == pytest.approx(expected, rel=1e-12)


def test_a_vortex_is_fastest_at_1_12_times_the_radius_of_its_core():
    part = frames(
        {
            "kind": "vortex",
            "circulation_m2_per_s": 300.0,
            "core_radius_m": 100.0,
            "center_m": [0.0, 0.0],
        },
        **{"grid.spacing_m": [1.0, 300.0, 300.0], "grid.cells": [300, 1, 1]},
        **{"nodes.cells": [[1, 1, 1], [5, 1, 1], [9, 1, 1]], "auvs.start_cells": [[1, 1, 1]]},
    )
    speeds = np.linalg.norm(part[1].field(0), axis=-1)
    assert speeds.argmax() == pytest.approx(112, abs=1)


def test_the_double_gyre_has_no_divergence_and_flows_through_no_edge():
    scenario, found = frames(
        {"kind": "double_gyre", "amplitude_m_per_s": 0.7, "epsilon": 0.25, "period_h": 0.4},
        **{"grid.spacing_m": [80.0, 60.0, 90.0], "episode.duration_s": 3000},
    )
    part = scenario.current.part
    sizes_m = np.array(scenario.grid.edges_m[:2]) * scenario.grid.cells[:2]
    rng, h = np.random.default_rng(0), 1e-4
    x, y = rng.uniform(0.1, 1.9, 50), rng.uniform(0.1, 0.9, 50)
    for shift in (-0.25, 0.0, 0.2):

        def at(x, y, shift=shift):
            return part.velocity(x, y, shift, sizes_m)

        # A step of h on [0, 2] × [0, 1] is so many metres.
        by_x = (at(x + h, y) - at(x - h, y))[:, 0] / (2 * h * sizes_m[0] / 2)
        by_y = (at(x, y + h) - at(x, y - h))[:, 1] / (2 * h * sizes_m[1])
        assert np.abs(by_x + by_y).max() < 1e-6 * np.abs(by_x).max()
        edge = np.linspace(0, 1, 20)
        for wall in (0.0, 2.0):
            assert np.abs(at(np.full(20, wall), edge)[:, 0]).max() < 1e-12
        for wall in (0.0, 1.0):
            assert np.abs(at(2 * edge, np.full(20, wall))[:, 1]).max() < 1e-12
    assert 0.7 < found.strongest_m_per_s() <= 0.7 * 1.5 * 2 * sizes_m[1] / sizes_m[0]


def test_a_tide_turns_within_its_period():
    tide = {"kind": "tide", "speed_m_per_s": 0.4, "toward_deg": 90.0, "period_h": 0.5}
    scenario, found = frames({**tide, "phase_deg": 30.0})
    times_s = (np.arange(scenario.num_slots) + 0.5) * scenario.slot_s
    expected = 0.4 * np.cos(2 * np.pi * times_s / 1800 + np.pi / 6)
    fields = np.array([found.field(slot)[0] for slot in found.slots()])
    assert fields[:, 0] == pytest.approx(expected)
    assert fields[:, 1] == pytest.approx(0)
    world = make(tide)
    state = world.reset()._replace(slot=np.array([world.num_slots]))
    last = world.current.at(state._replace(slot=state.slot - 1))
    assert world.current.at(state) == last


def test_shear_falls_off_with_the_depth_below_the_surface():
    shear = {"kind": "shear", "speed_m_per_s": 0.4, "toward_deg": 0.0, "depth_scale_m": 50.0}
    origin = {"latitude_deg": 1.0, "longitude_deg": 2.0, "depth_m": 20.0}
    scenario, found = frames(shear, **{"grid.origin": origin})
    depths_m = 20.0 + 100.0 * Grid.from_scenario(scenario).all_coordinates()[:, 2]
    assert found.field(0)[:, 1] == pytest.approx(0.4 * np.exp(-depths_m / 50))


# What moves cost, and where they lead.


@pytest.mark.parametrize("direction", [RIGHT, LEFT, AHEAD, DOWN, STAY])
def test_a_move_costs_what_its_speed_through_the_water_does(direction):
    world = make(uniform(0.8))
    way = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1], [0, 0, 0]])
    speed = np.linalg.norm(4.0 * way[direction] - [0.8, 0, 0])
    _, _, taken_j, _ = step(world, direction)
    expected_j = float(propulsion_power_w(speed, *HULL)) * world.link.slot_s
    assert taken_j == pytest.approx(expected_j, rel=1e-6)


@pytest.mark.parametrize("toward_deg", [0.0, 77.0])
def test_without_a_current_it_is_as_in_still_water(toward_deg):
    still, flowing = make("none", 3), make(uniform(0.0, toward_deg), 3)
    ours, theirs, rng = still.reset(seed=1), flowing.reset(seed=1), np.random.default_rng(0)
    for _ in range(40):
        action = np.stack([rng.integers(0, n, (3, 1)) for n in still.action_sizes], -1)
        ours, theirs = still.step(ours, action)[0], flowing.step(theirs, action)[0]
        for name, array in ours._asdict().items():
            assert getattr(theirs, name) == pytest.approx(array, rel=1e-6, abs=1e-9), name
        assert np.array_equal(still.action_mask(ours), flowing.action_mask(theirs))


def test_what_needs_too_much_speed_is_masked_and_chosen_holds():
    world = make(uniform(2.0))  # 5 m/s at most: against the current it would take 6
    mask = world.action_mask(world.reset())[0, 0, :7]
    # Up, the grid ends.
    assert mask.tolist() == [True, False, True, True, True, False, True]
    after, cell, taken_j, _ = step(world, LEFT)
    assert cell == [3, 3, 1]
    held_j = float(propulsion_power_w(2.0, *HULL)) * world.link.slot_s
    assert taken_j == pytest.approx(held_j, rel=1e-6)
    assert after.distance_m[0, 0] == 0


@pytest.mark.parametrize(
    ("toward_deg", "expected"),
    [(80.0, [4, 3, 1]), (280.0, [2, 3, 1]), (10.0, [3, 4, 1]), (170.0, [3, 2, 1])],
)
def test_what_cannot_hold_its_cell_drifts_along_the_stronger_component(toward_deg, expected):
    tide = {"kind": "tide", "speed_m_per_s": 4.9, "toward_deg": toward_deg, "period_h": 0.3}
    world = make(tide, vehicle={**MOTOR, "max_speed_m_per_s": 4.0})
    for direction in (STAY, UP):
        after, cell, taken_j, events = step(world, direction)
        assert cell == expected
        assert taken_j == 0
        assert after.distance_m[0, 0] == 100.0
        assert not events.left_grid[0, 0]


def test_what_drifts_to_the_edge_lies_aground_there():
    tide = {"kind": "tide", "speed_m_per_s": 4.9, "toward_deg": 90.0, "period_h": 5.0}
    world = make(tide, vehicle={**MOTOR, "max_speed_m_per_s": 4.0})
    state, cells = None, []
    for _ in range(10):
        state, cell, taken_j, _ = step(world, STAY, state)
        cells.append(cell[0])
        assert taken_j == 0
    width = world.grid.shape[0]
    assert cells == [min(4 + i, width) for i in range(len(cells))]
    assert cells[-2:] == [width, width]


def test_without_the_energy_to_hold_an_auv_drifts_and_an_empty_one_lies_on_the_bottom():
    world = make(uniform(1.5))
    slot_s, start = world.link.slot_s, world.reset()
    hotel_j = BATTERY["hotel_w"] * slot_s
    hold_j = float(propulsion_power_w(1.5, *HULL)) * slot_s
    for has_j, expected in (
        (hotel_j * 0.9, [3, 3, 1]),
        (hotel_j + hold_j * 0.9, [4, 3, 1]),
        (hotel_j + hold_j * 1.1, [3, 3, 1]),
    ):
        after, cell, _, events = step(world, LEFT, start._replace(battery_j=np.full((1, 1), has_j)))
        assert cell == expected
        assert events.stranded[0, 0] == (has_j < hotel_j)
        assert after.battery_j[0, 0] >= 0


def test_in_a_dock_an_auv_is_moored():
    dock = {"docks": [[3, 3, 1]], "dock_power_w": 300.0}
    tide = {"kind": "tide", "speed_m_per_s": 4.9, "toward_deg": 90.0, "period_h": 0.6}
    world = make(tide, vehicle={**MOTOR, **dock, "max_speed_m_per_s": 4.0})
    after, cell, taken_j, _ = step(world, STAY)
    assert cell == [3, 3, 1]
    assert taken_j == 0
    assert after.docked_j[0, 0] > 0


def test_nobody_drifts_into_another():
    tide = {"kind": "tide", "speed_m_per_s": 4.9, "toward_deg": 90.0, "period_h": 1.0}
    team = {"auvs.start_cells": [[3, 3, 1], [5, 3, 1], [1, 1, 1]]}
    world = make(tide, 4, {**MOTOR, "max_speed_m_per_s": 4.0}, **team)
    state, rng, stopped = world.reset(seed=0), np.random.default_rng(0), 0
    for _ in range(world.num_slots):
        action = np.stack([rng.integers(0, n, (4, 3)) for n in world.action_sizes], -1)
        state, events = world.step(state, action)
        stopped += events.blocked.sum()
        assert all(len(set(row)) == 3 for row in state.cell.tolist())
        assert (state.battery_j >= 0).all()
    assert stopped > 0


# Whoever plays.

CURRENTS = {
    "tide": {"kind": "tide", "speed_m_per_s": 4.9, "toward_deg": 30.0, "period_h": 0.3},
    "uniform": uniform(2.0, 200.0),
    "gyre": {"kind": "double_gyre", "amplitude_m_per_s": 3.0, "period_h": 0.3},
}


def scenario_in(kind, **changes):
    world = {"vehicle": {**MOTOR, "max_speed_m_per_s": 4.2}, "current": CURRENTS[kind]}
    return load_scenario("paper/k3-fdd", {**world, "observation.entries": ["current"], **changes})


@pytest.mark.parametrize("kind", CURRENTS)
def test_one_environment_number_by_number_is_the_world(kind):
    scenario = scenario_in(kind, **{"auvs.count": 2})
    world, slot = World(scenario), UnrolledSlot(scenario, with_mask=True)
    state, rng = world.reset(seed=0), np.random.default_rng(0)
    now = numbers(state)
    for _ in range(40):
        action = np.stack([rng.integers(0, n, (1, 2)) for n in world.action_sizes], axis=-1)
        state, events = world.step(state, action)
        now, last, _, observation, mask = slot(now, numbers([action]))
        assert now == numbers(state)
        assert last == numbers(events)
        assert np.allclose(observation, world.observe(state).ravel(), rtol=1e-12)
        assert mask == tuple(world.action_mask(state).ravel().tolist())


def test_batched_environments_and_single_ones_agree():
    scenario = scenario_in("tide")
    vector = gymnasium.make_vec("iout_marl:AUV-v0", num_envs=2, scenario=scenario)
    env = iout_v0.parallel_env(scenario)
    seen, _ = vector.reset(seed=0)
    env.reset(seed=0)
    for _ in range(40):
        action = vector.action_space.sample()
        seen, *_ = vector.step(action)
        single, *_ = env.step({"auv_0": action[0]})
        assert np.allclose(seen[0], single["auv_0"], rtol=1e-6)
        assert env.observation_space("auv_0").contains(single["auv_0"])
    vector.close()


@pytest.mark.slow
@pytest.mark.parametrize("policy", ["greedy", "tour", "planner", "return", "random-walk"])
@pytest.mark.parametrize("duplex", ["fdd", "tdd"])
def test_policies_play(tiny, policy, duplex):
    world = {"vehicle": {**MOTOR, "max_speed_m_per_s": 4.2}, "current": uniform(2.0, 200.0)}
    policy = PlannerPolicy(Budget(rounds=1)) if policy == "planner" else policy
    found = evaluate(tiny(world, f"paper/k3-{duplex}"), policy, 1)
    assert found.metrics["uplink_success"].mean > 0


def test_a_tour_goes_round_what_is_impossible():
    """To the left no AUV gets, but it charges and hears as before."""
    world = make(uniform(2.0)).scenario
    found = evaluate(world, "tour", 1).metrics
    assert found["uplink_success"].mean > 0.3


def test_trainings_run(tiny):
    world = {"vehicle": {**MOTOR, "max_speed_m_per_s": 4.2}, "current": CURRENTS["tide"]}
    scenario = tiny({**world, "observation.entries": ["current"], "training.mask_actions": True})
    trainer = Trainer(scenario)
    assert trainer.iterate()["vehicle/propulsion_kj"] > 0


def test_torch_in_single_precision_stays_near():
    scenario = scenario_in("gyre")
    world = World(scenario, 3)
    theirs = World(scenario, 3, library=torch, dtype="float32")
    state, other, rng = world.reset(seed=0), theirs.reset(seed=0), np.random.default_rng(2)
    for _ in range(30):
        action = np.stack([rng.integers(0, n, (3, 1)) for n in world.action_sizes], -1)
        state, _ = world.step(state, action)
        other, _ = theirs.step(other, torch.as_tensor(action))
    assert np.array_equal(other.cell.numpy(), state.cell)
    assert np.allclose(other.propulsion_j.numpy(), state.propulsion_j, rtol=1e-4)


def test_fields_too_many_for_a_table_by_slot_are_interpolated_on_the_way(monkeypatch):
    scenario, flows = scenario_in("gyre"), []
    for most in (2**20, 0):
        monkeypatch.setattr("iout_marl.core.current._MOST_BY_SLOT", most)
        world = World(scenario)
        state = world.reset(seed=0)
        slots = np.arange(0, scenario.num_slots + 1, 7)
        flows.append([world.current.at(state._replace(slot=slots[[i]])) for i in range(len(slots))])
    assert np.abs(flows[0]).max() > 0
    assert np.allclose(*flows, rtol=1e-12, atol=1e-15)


# What wanders by chance.

WANDERING = {
    "kind": "gauss_markov",
    "speed_m_per_s": 2.5,
    "toward_deg": 20.0,
    "sigma_m_per_s": 0.8,
    "time_constant_h": 0.05,
}


def test_a_current_that_wanders_is_that_of_the_oracle():
    motor = {**MOTOR, "max_speed_m_per_s": 4.1}
    world = make(
        {**WANDERING, "speed_m_per_s": 3.3}, 3, motor, **{"observation.entries": ["current"]}
    )
    scenario, chance, rng, drifted = (
        world.scenario,
        world.draw_chance(5),
        np.random.default_rng(0),
        0,
    )
    codes = node_codes(scenario, world.grid, [rng] * 3)
    # The last one is beyond where the current is cut off.
    first = np.array([[0.5, -1.2], [-0.3, 0.1], [7.0, -5.0]])
    state = world.reset(codes, current=first)
    oracles = [Oracle(scenario, scenario.nodes.cells[: scenario.num_nodes]) for _ in range(3)]
    for oracle, drawn in zip(oracles, first.tolist(), strict=True):
        oracle.water.start(drawn)
    for drawn, _ in zip(chance, range(world.num_slots), strict=False):
        action = np.stack([rng.integers(0, n, (3, 1)) for n in world.action_sizes], -1)
        state, _ = world.step(state, action, drawn)
        for env, oracle in enumerate(oracles):
            oracle.step(action[env].tolist())
            oracle.water.change(drawn.current[env].tolist())
            drifted += len(oracle.water.drifting)
            cell = world.grid.coordinate_table()[state.cell[env, 0]] + 1
            assert tuple(cell.tolist()) == oracle.auv_cells[0]
            assert state.battery_j[env] == pytest.approx(oracle.vehicles.battery_j, rel=1e-6)
        seen = [oracle.observe() for oracle in oracles]
        assert np.allclose(world.observe(state), seen, rtol=1e-6, atol=1e-6)
    assert drifted > 0


def test_a_current_that_wanders_has_its_standard_deviation_and_forgets():
    still = {**WANDERING, "speed_m_per_s": 0.0}
    world = make(still, 400, **{"episode.duration_s": 6000})
    state, chance = world.reset(seed=0), world.draw_chance(1)
    assert state.wander_m_per_s.std() == pytest.approx(0.8, rel=0.1)
    found = [state.wander_m_per_s]
    for _ in range(world.num_slots):
        action = np.zeros((400, 1, 3), dtype=np.int64)
        state, _ = world.step(state, action, next(chance))
        found.append(state.wander_m_per_s)
    added = np.array(found)
    assert added[:5].std() == pytest.approx(0.8, rel=0.05)
    assert added.std() == pytest.approx(0.8, rel=0.02)
    assert np.abs(added).max() <= 3.2
    persistence = np.exp(-world.link.slot_s / 180)
    correlation = np.corrcoef(added[1:].ravel(), added[:-1].ravel())[0, 1]
    assert correlation == pytest.approx(persistence, abs=0.01)


def test_a_current_begins_alone_as_in_a_batch():
    world = make(WANDERING, 3)
    scenario, three = world.scenario, world.reset(seed=4)
    for i in range(3):
        alone = World(scenario, 1).reset(seed=4 + i)
        assert np.array_equal(alone.wander_m_per_s[0], three.wander_m_per_s[i])
    played = EpisodeBatch(scenario, 3)
    played.reset([4, 5, 6])
    assert np.array_equal(played.current.wander_m_per_s, three.wander_m_per_s)
    played.reset([None, 4, None], np.array([False, True, False]))
    found = played.current.wander_m_per_s
    assert np.array_equal(found, three.wander_m_per_s[[0, 0, 2]])


def test_without_deviation_it_is_uniform():
    calm = {**WANDERING, "sigma_m_per_s": 0.0}
    world, plain = make(calm, 2), make(uniform(2.5, 20.0), 2)
    state, other, rng = world.reset(seed=0), plain.reset(seed=0), np.random.default_rng(0)
    for _, drawn in zip(range(40), world.draw_chance(0), strict=False):
        action = np.stack([rng.integers(0, n, (2, 1)) for n in world.action_sizes], -1)
        state, other = world.step(state, action, drawn)[0], plain.step(other, action)[0]
        assert np.array_equal(state.battery_j, other.battery_j)
        assert np.array_equal(state.cell, other.cell)


def test_a_training_goes_on_with_what_chance_has_added(tiny):
    scenario = tiny({"vehicle": MOTOR, "current": WANDERING, "training.rollout_slots": 5})
    trainer = Trainer(scenario)
    trainer.iterate()
    saved = trainer.collector.state_dict()
    other = Trainer(scenario)
    other.collector.load_state_dict([saved])
    ours, theirs = (each.collector.state.wander_m_per_s for each in (trainer, other))
    assert np.array_equal(ours, theirs)
    assert np.abs(ours).max() > 0
    saved = Trainer(tiny({"vehicle": MOTOR})).collector.state_dict()
    assert "wander_m_per_s" not in saved["state"]


@pytest.mark.filterwarnings("ignore:searches .tour, planner")
@pytest.mark.parametrize("policy", ["tour", "return"])
def test_policies_play_where_it_wanders(tiny, policy):
    found = evaluate(tiny({"vehicle": MOTOR, "current": WANDERING}), policy, 1)
    assert found.metrics["uplink_success"].mean > 0


# What is refused.

TIDE = {"kind": "tide", "speed_m_per_s": 0.3, "toward_deg": 40.0}
REFUSED = {
    "would change nothing: vehicle 'unlimited' counts no energy and has no "
    "vehicle.max_speed_m_per_s": {"vehicle": "unlimited"},
    "max_speed_m_per_s: must not be below the speed over ground, auvs.speed_m_per_s, 4 m/s": {
        "vehicle.max_speed_m_per_s": 3.9
    },
    "vehicle.max_speed_m_per_s: 4.1 m/s is too little to hold against the current anywhere: it is "
    "4.5 m/s at least": {"current": uniform(4.5), "vehicle.max_speed_m_per_s": 4.1},
    "is implausible: usual are 0 to 5 m/s (was 0.3 meant?)": {"current.speed_m_per_s": 30.0},
    "current.toward_deg: must be less than 360": {"current.toward_deg": 360.0},
    "current.kind: unknown kind 'tides'; did you mean 'tide'?": {"current": {"kind": "tides"}},
    "would make tables of": {
        "current": {"kind": "double_gyre", "amplitude_m_per_s": 0.2},
        "episode.duration_s": 2e7,
    },
    "current: there is none with current 'none'": {
        "current": "none",
        "observation.entries": ["current"],
    },
}


@pytest.mark.parametrize("message", REFUSED)
def test_refused_in_a_line(message):
    with pytest.raises(InputError) as refused:
        load_scenario("paper/k3-fdd", {"vehicle": MOTOR, "current": TIDE, **REFUSED[message]})
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_current_that_is_weak_enough_somewhere_or_at_some_time_is_not_refused():
    vehicle = {**MOTOR, "max_speed_m_per_s": 4.1}
    tide = {"kind": "tide", "speed_m_per_s": 4.9, "toward_deg": 0.0, "period_h": 0.5}
    shear = {"kind": "shear", "speed_m_per_s": 4.9, "toward_deg": 0.0, "depth_scale_m": 90.0}
    for current in (tide, shear):
        assert make(current, vehicle=vehicle).current is not None
    # One that keeps its depth never gets to where it is weak.
    with pytest.raises(InputError, match=r"4\.9 m/s at least"):
        make(shear, vehicle=vehicle, **{"auvs.motion": "planar"})


# What bounds say.


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"auvs.motion": "hover"}, ""),
        ({"auvs.motion": "six"}, "an AUV that cannot"),
        ({"auvs.motion": "hover", "episode.slot_s": 10.0}, "an AUV may drift to a cell to which"),
        ({"auvs.motion": "hover", "episode.slot_s": 60.0}, "an AUV may drift to a cell to which"),
        (
            {
                "auvs.motion": "hover",
                "episode.slot_s": 10.0,
                "vehicle": {"kind": "unlimited", "max_speed_m_per_s": 5.0},
            },
            "",
        ),
    ],
)
def test_bounds_are_those_of_still_water_where_currents_only_remove(tiny, changes, said):
    found = bound(tiny({"vehicle": MOTOR, "current": TIDE, **changes}), seconds=0)
    assert said in found.validity
    assert (found.energy_and_travel is None) == bool(said)
    if not said:
        changes = {**changes, "vehicle": "unlimited"}
        assert found.scheduling == bound(tiny(changes), seconds=0).scheduling


class Whirl(parts.Current):
    """A current from outside that states nothing but its frames."""

    def frames(self, scenario):
        cells = Grid.from_scenario(scenario).num_cells
        return parts.Frames.from_steady(np.tile([0.3, -0.2], (cells, 1)))


def test_a_current_from_outside_plays():
    parts.currents.register("whirl", version=1)(Whirl)
    try:
        world = make({"kind": "whirl"})
        assert world.current.strongest_m_per_s == pytest.approx(np.hypot(0.3, 0.2))
        assert "as stated by part 'whirl' (current)" in bound(world.scenario, seconds=0).validity
    finally:
        parts.currents.unregister("whirl")


# What is shown.


def test_views_show_the_current_where_there_is_one():
    world = make(uniform(0.8, 45.0))
    state = world.reset()
    assert "current 0.80 m/s ↗" in as_text(Snapshot.from_world(world, state, None))
    recording = record_policy(world.scenario, "greedy")
    data = recording.to_json()
    assert data["current_m_per_s"][0] == [pytest.approx([0.8 * 0.5**0.5] * 2)]
    again = Recording.from_json(data)
    assert np.array_equal(again.current_m_per_s, recording.current_m_per_s)
    assert "current 0.80 m/s ↗" in as_text(again.snapshot(3))
    assert r"0.80 m/s \u2197" in render_page([again])
    still = record_policy(make("none").scenario, "greedy")
    assert "current_m_per_s" not in still.to_json()
    assert "current" not in as_text(still.snapshot(3))
