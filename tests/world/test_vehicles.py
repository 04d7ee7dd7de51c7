"""Batteries of AUVs: energy is conserved, an empty one does nothing, all ways to play agree."""

import re

import gymnasium
import numpy as np
import pytest
import torch
from batteries import BATTERY, DOCKS

from iout_marl import InputError, World, evaluate, iout_v0, load_scenario, parts
from iout_marl.bounds import bound
from iout_marl.core.state import VEHICLE_FIELDS
from iout_marl.policies import Budget, PlannerPolicy
from iout_marl.replay.recorder import record_policy
from trainers import Trainer

TEAM = {"auvs.start_cells": [[5, 5, 2], [1, 2, 1], [3, 1, 2]]}
HOVER = {"auvs.motion": "hover", "auvs.idle_choices": True}
WORLDS = {
    "fdd": ("paper/k5-fdd", {}),
    "tdd": ("paper/k5-tdd", {}),
    "fdd-team": ("paper/k5-fdd", {"channel.access": "interference", **TEAM, **HOVER}),
    "tdd-stored-team": ("best/k5-tdd", {**TEAM, "grid.spacing_m": [100, 60, 40]}),
}
BATTERIES = {
    "as it is": {},
    "docks": DOCKS,
    "without hotel load": {"hotel_w": 0.0, "initial_share": 0.25, **DOCKS},
    "nearly empty": {"initial_share": 0.13, **DOCKS},
}


def make(case, battery=(), num_envs=4, changes=(), **options):
    name, of_case = WORLDS[case]
    vehicle = {**BATTERY, **dict(battery)}
    scenario = load_scenario(name, {**of_case, "vehicle": vehicle, **dict(changes)})
    return World(scenario, num_envs, **options)


def slots(world, seed=0):
    rng, state = np.random.default_rng(seed), world.reset(seed=seed)
    shape = world.num_envs, world.num_auvs
    for _ in range(world.num_slots):
        before = state
        action = np.stack([rng.integers(0, n, shape) for n in world.action_sizes], -1)
        state, events = world.step(before, action)
        yield before, action, events, state


@pytest.mark.parametrize("library", [np, torch])
def test_of_auvs_in_one_cell_each_sees_the_others(library):
    entries = {"observation.entries": ["batteries"], "auvs.separation_cells": 0}
    world = make("fdd-team", num_envs=1, changes=entries, library=library)
    state, shares = world.reset(seed=0), [0.5, 0.25, 0.125]
    battery_j = world.backend.floats([shares]) * world.vehicle.capacity_j
    together = state._replace(cell=state.cell * 0 + state.cell[:, :1], battery_j=battery_j)
    seen = np.asarray(world.observe(together))[0, :, -2:]
    np.testing.assert_allclose(seen, [[0.25, 0.125], [0.5, 0.125], [0.5, 0.25]])


def test_a_dock_fills_a_battery_up_and_no_further():
    world = make("fdd", {**DOCKS, "capacity_j": 125_000.3}, num_envs=5000, changes=HOVER)
    battery_j = np.random.default_rng(0).uniform(0.1, 1, (5000, 1)) * world.vehicle.capacity_j
    staying = np.array([world.action_sizes]).repeat(5000, axis=0)[:, None] - 1
    after, _ = world.step(world.reset()._replace(battery_j=battery_j), staying)
    # 95,000 J come in a slot of 25 s beside the hotel load.
    assert (after.battery_j <= world.vehicle.capacity_j).all()
    assert after.battery_j == pytest.approx(world.vehicle.capacity_j, rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("battery", BATTERIES)
@pytest.mark.parametrize("case", WORLDS)
def test_energy_is_conserved_to_the_joule_of_every_auv(case, battery):
    world = make(case, BATTERIES[battery])
    vehicle, drawn_j = world.vehicle, 0.0
    for before, _, events, after in slots(world):
        assert (after.battery_j >= 0).all()
        assert (after.battery_j <= vehicle.capacity_j).all()
        drawn_j = drawn_j + events.drawn_j
        gap_j = vehicle.initial_j + after.docked_j - drawn_j - after.battery_j
        assert np.abs(gap_j).max() < 1e-6
        idle = (after.cell == before.cell) & (events.charged == events.heard)
        idle &= (events.charged == world.num_nodes) & (events.spent_j == 0) & ~events.left_grid
        assert (idle | ~events.stranded).all()
    spent_j = after.propulsion_j + after.hotel_j + after.charging_j
    assert np.abs(spent_j - drawn_j).max() < 1e-6
    assert (after.docked_j.sum() > 0) == ("docks" in BATTERIES[battery]) or world.num_auvs == 1
    assert after.stranded_slots.sum() > 0 or battery == "without hotel load"
    assert after.charging_j.sum() > 0


def test_charging_costs_what_the_source_draws_and_a_move_what_drag_does():
    world = make("fdd", num_envs=1)
    slot_s, way_m = world.link.slot_s, 100.0
    state, _ = world.step(world.reset(), np.array([[[0, 0, 1]]]))
    move_w = 0.5 * 1025 * 0.006 * 3.0 * (way_m / slot_s) ** 3 / 0.7
    assert state.distance_m[0, 0] == way_m
    assert state.propulsion_j[0, 0] == pytest.approx(move_w * slot_s)
    assert state.hotel_j[0, 0] == 200 * slot_s
    assert state.charging_j[0, 0] == world.scenario.charging.power_w * slot_s


def test_an_empty_auv_stays_where_it_is_until_it_is_given_something_in_a_dock():
    here = {"docks": [[5, 5, 2]], "dock_power_w": 5000.0, "initial_share": 0.06}
    for docks, expected in (
        (here, [(True, False), (False, True), (False, True)]),
        ({**here, "docks": [[1, 1, 1]]}, [(True, False)] * 3),
    ):
        world = make("fdd", docks, 1, HOVER)
        state = world.reset()._replace(battery_j=np.array([[10.0]]))
        found = []
        for _ in expected:
            cell = state.cell
            state, events = world.step(state, np.array([[[1, 0, 0]]]))
            found.append((bool(events.stranded[0, 0]), bool((state.cell != cell)[0, 0])))
        assert found == expected
        assert state.stranded_slots[0, 0] == sum(stranded for stranded, _ in expected)


def test_what_cannot_be_paid_for_is_left():
    """Little is enough to hear, more to move, much to charge."""
    world = make("fdd", num_envs=1)
    start, hotel_j = world.reset(), 200 * world.link.slot_s
    state, _ = world.step(start, np.array([[[0, 0, 0]]]))
    move_j, charging_j = state.propulsion_j[0, 0], state.charging_j[0, 0]
    for has_j, moves, charges in (
        (hotel_j, False, False),
        (hotel_j + move_j, True, False),
        (hotel_j + charging_j * 0.999, True, False),
        (hotel_j + move_j + charging_j, True, True),
    ):
        poor = start._replace(battery_j=np.full((1, 1), has_j))
        after, events = world.step(poor, np.array([[[0, 0, 1]]]))
        assert (after.cell != start.cell)[0, 0] == moves
        assert (events.charged[0, 0] == 0) == (events.harvested_j[0, 0] > 0) == charges
        assert events.heard[0, 0] == 1
        assert not events.stranded[0, 0]


def test_vehicles_without_end_of_energy_add_nothing():
    """No operation, no column of a state, no metric."""
    world = World("paper/k5-fdd")
    state = world.reset()
    fields, drawn_j = world.vehicle.after(state, None, None, None, None)
    assert all(fields[name] is getattr(state, name) for name in VEHICLE_FIELDS)
    assert drawn_j.shape == state.battery_j.shape == (1, 0)
    assert "battery_share" not in world.metrics(state)


@pytest.mark.slow
@pytest.mark.parametrize("case", WORLDS)
def test_a_battery_that_is_never_empty_changes_nothing(case):
    large = {"capacity_j": 1e12}
    limited = make(case, large)
    name, changes = WORLDS[case]
    plain = World(load_scenario(name, changes), 4)
    for one, other in zip(slots(plain), slots(limited), strict=True):
        for theirs, ours in ((one[2], other[2]), (one[3], other[3])):
            for field in ("cell", "age", "energy_j", "delivered", "left_grid", "blocked"):
                if hasattr(theirs, field):
                    assert np.array_equal(getattr(theirs, field), getattr(ours, field))
        assert np.array_equal(plain.action_mask(one[3]), limited.action_mask(other[3]))


@pytest.mark.slow
@pytest.mark.parametrize("case", WORLDS)
def test_torch_and_single_environments_agree(case):
    entries = ["battery"] + ["batteries"] * case.endswith("team")
    penalties = {"reward.vehicle_energy_penalty_per_kj": 0.1, "reward.stranded_penalty": 2.0}
    changes = {"observation.entries": entries, **penalties}
    world = make(case, DOCKS, changes=changes)
    theirs = make(case, DOCKS, changes=changes, library=torch)
    env = iout_v0.parallel_env(world.scenario)
    env.reset(seed=0)
    state, other = world.reset(seed=0), theirs.reset(seed=0)
    rng = np.random.default_rng(1)
    for _ in range(60):
        shape = (world.num_envs, world.num_auvs)
        action = np.stack([rng.integers(0, n, shape) for n in world.action_sizes], -1)
        state, events = world.step(state, action)
        other, _ = theirs.step(other, torch.as_tensor(action))
        seen, rewards, *_ = env.step(dict(zip(env.possible_agents, action[0], strict=True)))
        ours = world.observe(state)[0].astype(np.float32)
        assert np.allclose(np.stack(list(seen.values())), ours, rtol=1e-6)
        assert np.allclose(list(rewards.values()), world.reward(state, events)[0], rtol=1e-6)
    assert state.stranded_slots.sum() > 0
    for name in VEHICLE_FIELDS:
        assert np.allclose(getattr(other, name).numpy(), getattr(state, name), rtol=1e-12)


def test_batched_environments_are_those_of_single_ones():
    scenario = make("fdd-team", DOCKS, changes={"observation.entries": ["battery"]}).scenario
    vector = gymnasium.make_vec("iout_marl:AUV-v0", num_envs=3, scenario=scenario)
    world = World(scenario, 3)
    seen, _ = vector.reset(seed=0)
    state = world.reset(seed=0)
    for _ in range(30):
        action = vector.action_space.sample()
        seen, *_ = vector.step(action)
        state, _ = world.step(state, action.reshape(3, world.num_auvs, -1))
        assert np.allclose(seen.reshape(3, world.num_auvs, -1), world.observe(state), rtol=1e-6)
    vector.close()


def test_to_a_stranded_auv_the_mask_leaves_what_it_can_do():
    for changes, directions, nodes in (
        (HOVER, 1, 1),
        ({}, None, None),
        ({"auvs.motion": "hover"}, 1, None),
    ):
        world = make("fdd", num_envs=1, changes=changes)
        start = world.reset()
        whole = world.action_mask(start)[0, 0]
        mask = world.action_mask(start._replace(battery_j=np.zeros((1, 1))))[0, 0]
        ends = np.cumsum(world.action_sizes)[:-1]
        for left, usual, number in zip(
            np.split(mask, ends), np.split(whole, ends), (directions, nodes, nodes), strict=True
        ):
            assert left.sum() == (usual.sum() if number is None else number)
            assert left[-1] or number is None


@pytest.mark.slow
@pytest.mark.parametrize("policy", ["greedy", "tour", "planner", "return"])
@pytest.mark.parametrize("duplex", ["fdd", "tdd"])
def test_policies_play(tiny, policy, duplex):
    scenario = tiny({"vehicle": {**BATTERY, "capacity_j": 2e5}}, f"paper/k3-{duplex}")
    found = evaluate(
        scenario, PlannerPolicy(Budget(rounds=1)) if policy == "planner" else policy, 1
    )
    assert found.metrics["uplink_success"].mean > 0
    assert 0 <= found.metrics["stranded_share"].mean <= 1


def test_trainings_go_on_where_they_were(tiny):
    scenario = tiny({"vehicle": BATTERY, "reward.stranded_penalty": 5.0})
    trainer = Trainer(scenario)
    assert trainer.iterate()["vehicle/charging_kj"] > 0
    saved = trainer.collector.state_dict()
    other = Trainer(scenario)
    other.collector.load_state_dict([saved])
    assert np.array_equal(other.collector.state.battery_j, trainer.collector.state.battery_j)


def test_a_training_of_before_has_no_batteries(tiny):
    trainer = Trainer(tiny())
    trainer.iterate()
    saved = trainer.collector.state_dict()
    assert not set(VEHICLE_FIELDS) & set(saved["state"])
    trainer.collector.load_state_dict([saved])
    assert trainer.collector.state.battery_j.shape[-1] == 0


def test_bounds_of_batteries_are_those_without_where_auvs_can_rest(tiny):
    hover = {"auvs.motion": "hover"}
    with_battery = tiny({"vehicle": {**BATTERY, **DOCKS, "docks": [[1, 1, 1]]}, **hover})
    found, expected = (bound(each, seconds=0) for each in (with_battery, tiny(hover)))
    assert found.validity == expected.validity == "both bounds hold for every policy"
    assert found.scheduling == expected.scheduling
    drifts = bound(tiny({"vehicle": BATTERY}), seconds=0)
    assert drifts.energy_and_travel is None
    assert "an AUV that cannot pay for a move stays where it is, which motion 'six'" in (
        drifts.validity
    )


class Glider(parts.Vehicle):
    """Linear drag, and nothing else stated."""

    capacity_j, initial_j, hotel_w = 5e4, 4e4, 3.0

    def propulsion_power_w(self, speed_m_per_s):
        return 50.0 * speed_m_per_s


def test_one_of_a_users_own_states_what_it_has_and_what_speed_takes():
    parts.vehicles.register("glider", version=1)(Glider)
    try:
        scenario = load_scenario("paper/k5-fdd", {"vehicle": "glider"})
        world = World(scenario)
        state, events = world.step(world.reset(), np.array([[[0, 0, 0]]]))
        assert state.propulsion_j[0, 0] == 50 * 4 * 25
        assert state.hotel_j[0, 0] == 75
        assert events.charged[0, 0] == 5  # for charging it has too little
        assert "vehicle 'glider' does not state that it does" in bound(scenario, seconds=0).validity
    finally:
        parts.vehicles.unregister("glider")


def test_why_an_empty_auv_hears_nobody_is_recorded(tiny):
    scenario = tiny({"vehicle": {**BATTERY, "capacity_j": 6e4}})
    recording = record_policy(scenario, "greedy")
    codes = {reason.code for reason in recording.reasons}
    assert "stranded" in codes


@pytest.mark.parametrize(
    ("dock", "changes", "is_reached"),
    [
        ([12, 8, 2], {}, True),
        ([1, 1, 3], {}, False),
        ([1, 1, 3], {"auvs.motion": "hover"}, True),
        ([1, 1, 3], {"auvs.start_cells": [[1, 1, 2], [5, 5, 3]]}, True),
        # The second AUV starts in the farthest corner, but at the depth of the first.
        ([1, 1, 1], {"auvs.count": 2}, False),
    ],
)
def test_a_dock_lies_where_auvs_can_come(dock, changes, is_reached):
    docks = {"vehicle.docks": [[1, 1, 2], dock], "vehicle.dock_power_w": 500}
    if is_reached:
        load_scenario("sea/bay", changes | docks)
        return
    said = f"vehicle.docks[1]: no AUV can come to cell {dock}: with auvs.motion 'planar'"
    with pytest.raises(InputError, match=re.escape(said)):
        load_scenario("sea/bay", changes | docks)


def test_of_those_that_keep_their_depth_all_start_at_one_that_is_given():
    scenario = load_scenario("sea/bay", {"auvs.count": 3})
    assert {cell[2] for cell in scenario.starts().tolist()} == {1}
    with pytest.raises(InputError, match="only 96 AUVs find room"):
        load_scenario("sea/bay", {"auvs.count": 97})
