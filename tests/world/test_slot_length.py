"""Slots of a length of their own: moves over several slots, and over several cells in one."""

import numpy as np
import pytest
import torch

from iout_marl import InputError, World, evaluate, load_scenario
from iout_marl.bounds import least_age_sum
from iout_marl.breakdown import Tally
from iout_marl.envs import AUVEnv, AUVVectorEnv
from iout_marl.testing import check_vector_env
from iout_marl.world import Events
from trainers import Trainer

TEAM = {"auvs.start_cells": [[5, 5, 2], [5, 8, 2], [8, 5, 2]]}
SHORT, LONG = {"episode.slot_s": 10}, {"episode.slot_s": 60}
RIGHT, LEFT, UP = 0, 1, 2


def coordinates(world, cell):
    return (world.grid.coordinate_table()[cell] + 1).tolist()


def moved(changes, *directions, name="paper/k3-fdd"):
    """The world, and the states after slots in these directions, of all AUVs alike or of each."""
    world = World(name, overrides=changes)
    states = [world.reset()]
    for direction in directions:
        action = np.zeros((1, world.num_auvs, 3), dtype=np.int64)
        action[..., 0] = direction
        states.append(world.step(states[-1], action)[0])
    return world, states


def test_without_a_length_nothing_is_new():
    plain = load_scenario("paper/k3-fdd")
    assert load_scenario(plain, {"episode.slot_s": None}).hash == plain.hash
    assert load_scenario(plain, {"episode.slot_s": 25}).hash != plain.hash
    world, (state,) = moved({})
    assert state.transit_slots.size == state.course.size == 0
    assert world.motion.heading(state) is state.cell


def test_the_length_that_follows_from_the_speed_may_be_written_out():
    plain, same = (
        World("paper/k3-fdd", 4),
        World("paper/k3-fdd", 4, overrides={**LONG, "episode.slot_s": 25}),
    )
    state, other = plain.reset(), same.reset()
    rng = np.random.default_rng(0)
    for _ in range(plain.num_slots):
        action = np.stack([rng.integers(0, n, (4, 1)) for n in plain.action_sizes], -1)
        (state, _), (other, _) = plain.step(state, action), same.step(other, action)
        for name in ("cell", "age", "energy_j", "deliveries", "age_sum", "transit_slots"):
            assert np.array_equal(getattr(state, name), getattr(other, name)), name


def test_a_long_move_ends_in_its_last_slot_and_ignores_directions_meanwhile():
    # 25 s for a cell: three slots of 10 s.
    world, states = moved(SHORT, RIGHT, LEFT, UP, UP)
    cells = [coordinates(world, state.cell[0, 0]) for state in states]
    assert cells == [[5, 5, 2]] * 3 + [[6, 5, 2]] * 2
    assert [int(state.transit_slots[0, 0]) for state in states] == [0, 2, 1, 0, 2]
    assert coordinates(world, world.motion.heading(states[1])[0, 0]) == [6, 5, 2]
    assert coordinates(world, world.motion.heading(states[4])[0, 0]) == [6, 6, 2]


def test_under_way_all_directions_but_the_first_are_masked_out():
    world, states = moved(SHORT, LEFT, UP, UP)
    masks = [world.action_mask(state)[0, 0, :6].tolist() for state in states]
    only_first = [True] + [False] * 5
    assert masks[1] == masks[2] == only_first
    assert masks[0] == masks[3] == [True] * 6


def test_who_would_leave_the_grid_stays_and_is_not_under_way():
    world, states = moved({**SHORT, "auvs.start_cells": [[10, 1, 1]]}, RIGHT)
    assert states[1].transit_slots == 0
    assert coordinates(world, states[1].cell[0, 0]) == [10, 1, 1]


def test_a_long_slot_covers_several_cells_up_to_the_edge():
    world, states = moved({**LONG, "auvs.start_cells": [[7, 1, 1]]}, RIGHT, RIGHT, RIGHT)
    assert [coordinates(world, s.cell[0, 0])[0] for s in states] == [7, 9, 10, 10]
    assert states[0].transit_slots.size == 0


def test_a_nearby_node_is_charged_from_where_the_auv_is_at_the_end_of_the_slot():
    world = World("paper/k3-fdd", overrides={**SHORT, "auvs.start_cells": [[1, 1, 1]]})
    state, action = world.reset(), np.zeros((1, 1, 3), dtype=np.int64)
    harvested_j = []
    for _ in range(4):
        state, events = world.step(state, action)
        harvested_j.append(float(events.harvested_j[0, 0]))
        offset = world.link.offset(state.cell, state.node_cell[:, :1])
        expected = world.link.at(world.link.harvested_w, offset) * 10
        assert events.harvested_j == pytest.approx(expected)
    assert harvested_j[0] == harvested_j[1] != harvested_j[2]


@pytest.mark.slow
@pytest.mark.parametrize("slot_s", [7, 12.5, 25, 60, 110])
@pytest.mark.parametrize("separation", [1, 2.5])
def test_auvs_that_were_apart_stay_apart_on_any_library(slot_s, separation):
    changes = {**TEAM, "episode.slot_s": slot_s, "auvs.separation_cells": separation}
    changes |= {"auvs.motion": "hover"}
    world = World("paper/k3-fdd", 6, overrides=changes)
    tensors = World("paper/k3-fdd", 6, torch, overrides=changes)
    state, other, blocked = world.reset(), tensors.reset(), 0
    rng, apart = np.random.default_rng(1), world.grid.offset_distances()
    for _ in range(90):
        action = np.stack([rng.integers(0, n, (6, 3)) for n in world.action_sizes], -1)
        reachable = world.motion.reachable(state)
        chosen = np.take_along_axis(reachable, action[..., :1], -1)[..., 0]
        state, events = world.step(state, action)
        other, _ = tensors.step(other, torch.as_tensor(action))
        assert np.array_equal(np.where(events.blocked, state.cell, chosen), state.cell)
        blocked += events.blocked.sum()
        for name in ("cell", "transit_slots", "course"):
            assert np.array_equal(getattr(state, name), np.asarray(getattr(other, name)))
        for one, two in ((0, 1), (0, 2), (1, 2)):
            between = state.cell[:, one] - state.cell[:, two] + world.grid.offset_origin
            assert (apart[between] >= separation * (1 - 1e-9)).all()
    assert blocked > 0 or separation == 1


def test_what_is_left_of_a_move_is_seen_where_it_is_listed():
    with pytest.raises(ValueError, match="transit: no move takes longer than a slot"):
        load_scenario("paper/k3-fdd", {"observation.entries": ["transit"]})
    changes = {**SHORT, "observation.entries": ["transit"]}
    world, states = moved(changes, RIGHT, RIGHT, RIGHT)
    assert [float(world.observe(state)[0, 0, -1]) for state in states] == [0, 2, 1, 0]
    assert [float(world.observer.observe_globally(s)[0, -1]) for s in states] == [0, 2, 1, 0]
    changes["observation.kind"] = "scaled"
    world, states = moved(changes, RIGHT, RIGHT, RIGHT)
    assert [float(world.observe(state)[0, 0, -1]) for state in states] == [0, 1, 0.5, 0]


@pytest.mark.parametrize("changes", [SHORT, LONG, {**SHORT, "age.sampling": "packet_start"}])
def test_environments_and_trainings_run(changes, tiny):
    team = {**changes, "auvs.start_cells": [[2, 1, 1], [1, 2, 1]], "nodes.count": 2}
    scenario = tiny({**team, "episode.duration_s": 300})
    log = Trainer(scenario).iterate()
    assert np.isfinite(log["ppo/loss"])
    alone = tiny({**changes, "episode.duration_s": 300})
    check_vector_env(lambda: AUVVectorEnv(alone, 3), lambda: AUVEnv(alone), seeds=(7,))


@pytest.mark.parametrize("changes", [SHORT, LONG])
@pytest.mark.parametrize("policy", ["greedy", "round-robin", "tour"])
def test_policies_and_replays_play(changes, policy, tiny):
    found = evaluate(tiny(changes), policy, 1, breakdown=True)
    mean_s = found.breakdown.nodes["mean_aoi_s"].mean()
    assert found.metrics["mean_aoi_s"].mean == pytest.approx(mean_s)


def test_ages_over_time_are_those_of_packets():
    changes = {"age.sampling": "packet_start", "charging.power_w": 1e6}
    world = World("best/k3-tdd", overrides=changes)
    state, rng, total = world.reset(), np.random.default_rng(0), 0.0
    young = 0
    for _ in range(world.num_slots):
        action = np.stack([rng.integers(0, n, (1, 1)) for n in world.action_sizes], -1)
        before = state
        state, events = world.step(before, action)
        # In TDD a packet takes what charging leaves of the slot.
        heard = int(events.heard[0, 0])
        if events.delivered[0, 0]:
            assert state.age[0, heard] == pytest.approx(1 - float(events.beta[0, 0]))
            young += state.age[0, heard] < 1
        steps = np.linspace(0, 1, 2001)[:, None]
        total += np.minimum(before.age + steps, world.scenario.age.maximum).mean()
    assert young > 0
    assert state.age_sum[0] == pytest.approx(total, rel=1e-3)
    mean_s = world.metrics(state)["mean_aoi_s"][0]
    assert mean_s == pytest.approx(total / world.num_slots * world.link.slot_s, rel=1e-3)


def test_sums_of_ages_are_bounded_in_whole_slots():
    message = r"age\.sampling: packet_start: sums of ages are bounded in whole slots"
    with pytest.raises(InputError, match=message):
        least_age_sum("paper/k3-fdd", overrides={"age.sampling": "packet_start"})


def test_all_slots_of_a_long_move_are_moving_ones():
    changes = {**SHORT, "auvs.motion": "hover", "episode.duration_s": 80}
    world, states = moved(changes, RIGHT, 6, 6, 6, RIGHT, RIGHT, RIGHT, 6)
    tally = Tally(world, states[0])
    nothing, no_rounds = np.zeros((1, 1)), np.zeros((1, 1, 0))
    for state in states[1:]:
        whom = np.zeros((1, 1), dtype=np.int64)
        tally.add(state, Events(nothing, nothing, whom, whom, *[nothing] * 7, *[no_rounds] * 5))
    found = tally.result(states[-1]).auvs
    # Two moves of three slots each, over a cell of 100 m.
    assert (found["moving_slots"], found["moving_s"], found["distance_m"]) == (6, 60, 200)


@pytest.mark.parametrize("changes", [{}, SHORT])
def test_trainings_go_on_with_moves_that_are_not_over(changes, tiny):
    first, second = (Trainer(tiny(changes), seed) for seed in (0, 1))
    first.iterate()
    saved = first.state_dict()
    assert ("transit_slots" in saved["collector"]["state"]) == bool(changes)
    second.load_state_dict(saved)
    first.iterate()
    second.iterate()
    expected = first.weights()
    assert all(torch.equal(tensor, expected[name]) for name, tensor in second.weights().items())
