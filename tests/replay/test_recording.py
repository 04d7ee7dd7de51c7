"""A recording is what was played: of any policy, and of somebody's own loop."""

import copy
import json
import re
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from batteries import BATTERY, DOCKS
from polling import polling

import iout_marl
from iout_marl import (
    InputError,
    Recording,
    Trajectory,
    World,
    iout_v0,
    load_scenario,
    record,
    record_policy,
)
from iout_marl.evaluation import play
from iout_marl.policies import make_baseline
from iout_marl.render import Snapshot, as_text
from iout_marl.replay import Recorder
from iout_marl.replay.moves import arrives, progress
from iout_marl.replay.page import render_page
from iout_marl.scenario.loading import parse_scenario

#: A charging slot, a sending slot, and several AUVs are among them.
SCENARIOS = ("paper/k3-fdd", "best/k5-tdd", "multi/m3-k10-fdd")


@pytest.fixture(scope="module")
def data():
    return record_policy("multi/m2-k10-fdd", "random-walk", 3).to_json()


def same(first, second):
    a, b = first.to_json(), second.to_json()
    return {key: value for key, value in a.items() if b[key] != value}


@pytest.mark.slow
@pytest.mark.parametrize("scenario", SCENARIOS)
def test_recording_holds_every_state_and_event(scenario):
    recording = record_policy(scenario, "random-walk", 7)
    world = World(scenario)
    cells = world.grid.coordinate_table() + 1
    for place, (state, events) in enumerate(play(world, make_baseline("random-walk"), 7)):
        assert np.array_equal(recording.path[place], cells[state.cell[0]])
        assert np.array_equal(recording.ages[place], state.age[0])
        assert np.array_equal(recording.energy_j[place], state.energy_j[0])
        assert np.array_equal(recording.deliveries[place], state.deliveries[0])
        if events is None:
            continue
        assert np.array_equal(recording.heard[place - 1], events.heard[0] + 1)
        assert np.array_equal(recording.delivered[place - 1], events.delivered[0])
        assert np.array_equal(recording.rewards[place - 1], world.reward(state, events)[0])
        for name in ("beta", "harvested_j", "spent_j", "left_grid", "blocked"):
            assert np.array_equal(getattr(recording, name)[place - 1], getattr(events, name)[0])
    assert place == recording.slots == recording.num_slots


@pytest.fixture(scope="module")
def polled():
    """An episode of two AUVs under exclusive access, who poll and now and then collide."""
    changes = {"auvs.count": 2, "channel.access": "exclusive", "auvs.idle_choices": True}
    scenario = load_scenario("paper/k5-fdd", polling(3, **{"charging.power_w": 8000, **changes}))
    return record_policy(scenario, "random-walk", 3)


def test_all_nodes_heard_in_a_slot_are_recorded(polled, tmp_path):
    world = World(parse_scenario(Path("scenario.yaml"), polled.scenario_yaml.encode()))
    slots = list(play(world, make_baseline("random-walk"), 3))
    for slot, (state, events) in enumerate(slots[1:]):
        there = events.polled[0] < world.num_nodes
        assert np.array_equal(polled.polled[slot] > 0, there)
        assert np.array_equal(polled.polled[slot][there], events.polled[0][there] + 1)
        assert np.array_equal(polled.polled_delivered[slot], events.polled_delivered[0])
        assert np.array_equal(polled.polled_j[slot], events.polled_j[0])
        assert np.array_equal(polled.deliveries[slot + 1], state.deliveries[0])
        ours = polled.snapshot(slot + 1)
        assert ours.hearing() == Snapshot.from_world(world, state, events).hearing()
        assert as_text(ours) == as_text(Snapshot.from_world(world, state, events))
        for auv in range(world.num_auvs):
            heard = [(n + 1, ok) for who, n, ok in ours.hearing() if who == auv]
            said = [(u.node, u.reason is None) for u in polled.uplinks(slot, auv)]
            assert said == heard
    lost = polled.reasons[polled.polled_outcome.max() - 1]
    assert lost.code == "collision"
    assert polled.polled_delivered.sum() > 20
    polled.save(tmp_path / "episode.json")
    assert not same(polled, Recording.load(tmp_path / "episode.json"))


def test_what_is_drawn_and_kept_of_an_episode_has_all_nodes_heard(polled):
    drawn = Trajectory.from_recording(polled)
    assert Trajectory(**json.loads(json.dumps(drawn.to_json()))) == drawn
    packets = sum(map(sum, drawn.delivered)) + sum(arrived for *_, arrived in drawn.polls())
    assert packets == polled.deliveries[-1].sum()
    assert len(list(drawn.polls())) == np.count_nonzero(polled.polled)
    plain = Trajectory.from_recording(record_policy("paper/k3-fdd", "random-walk", 3))
    assert "polled" not in plain.to_json()


def test_recordings_of_before_have_nobody_polled(data):
    assert not {"polled", "polled_outcome", "polled_j"} & data.keys()
    assert Recording.from_json(data).polled.shape == (100, 2, 0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"polled_j": None}, "polled_j is missing, but polled is there"),
        ({"polled": [[[]]]}, "polled must hold a list that is not empty"),
        ({"polled": 3}, "polled must hold a list"),
        ({"polled_outcome": [[[0]]]}, r"polled_outcome must be 50 × 2 × 3 \(slots, auvs, rounds"),
    ],
)
def test_damaged_polls_are_said_in_one_line(polled, changes, message):
    damaged = {k: v for k, v in {**polled.to_json(), **changes}.items() if v is not None}
    with pytest.raises(InputError, match=message):
        Recording.from_json(damaged)


@pytest.mark.slow
@pytest.mark.parametrize("scenario", SCENARIOS)
def test_nobody_is_0(scenario, tmp_path):
    overrides = {"auvs.idle_choices": True}
    recording = record_policy(scenario, "random-walk", 7, overrides=overrides)
    world = World(scenario, overrides=overrides)
    nobody = world.num_nodes
    slots = list(play(world, make_baseline("random-walk"), 7))
    for place, (state, events) in enumerate(slots[1:], start=1):
        heard, charged = recording.heard[place - 1], recording.charged[place - 1]
        assert np.array_equal(heard == 0, events.heard[0] == nobody)
        assert (charged[events.charged[0] == nobody] == 0).all()
        for auv in np.flatnonzero(heard == 0):
            assert recording.reason(place - 1, auv).code == "nobody_asked"
        assert np.array_equal(recording.deliveries[place], state.deliveries[0])
        ours, theirs = recording.snapshot(place), Snapshot.from_world(world, state, events)
        assert ours.charging() == theirs.charging()
        assert ours.hearing() == theirs.hearing()
        assert {auv for auv, *_ in ours.hearing()} == set(np.flatnonzero(heard))
    assert 0 < np.count_nonzero(recording.asked) < recording.heard.size
    recording.save(tmp_path / "episode.json")
    assert not same(recording, Recording.load(tmp_path / "episode.json"))
    drawn = Trajectory.from_recording(recording)
    assert not np.array(drawn.delivered)[np.array(drawn.heard) == 0].any()


def test_a_packet_from_nobody_is_a_fault(data):
    slot, auv = np.argwhere(np.array(data["outcome"]) == 0)[0].tolist()
    wrong = changed(data, f"heard.{slot}.{auv}", 0)
    place = rf"outcome\[{slot + 1}, {auv + 1}\]"
    with pytest.raises(InputError, match=f"^recording: {place} is a packet that arrived, but"):
        Recording.from_json(wrong)


@pytest.mark.slow
@pytest.mark.parametrize("scenario", SCENARIOS)
def test_snapshots_are_those_of_the_world(scenario):
    recording, world = record_policy(scenario, "greedy"), World(scenario)
    for place, (state, events) in enumerate(play(world, make_baseline("greedy"))):
        expected = Snapshot.from_world(world, state, events)
        found = recording.snapshot(place)
        for name in Snapshot.__dataclass_fields__:
            if name not in ("charged", "total_harvested_j"):
                assert np.array_equal(getattr(found, name), getattr(expected, name)), name
        assert found.charging() == expected.charging()
        assert found.total_harvested_j == pytest.approx(expected.total_harvested_j)


def test_balance_of_energy():
    """What nodes have is what they have harvested, less what they have spent."""
    recording = record_policy("multi/m3-k10-fdd", "tour")
    for node in range(recording.num_nodes):
        gained = recording.harvested_j * (recording.charged == node + 1)
        spent = recording.spent_j * (recording.heard == node + 1)
        left = np.cumsum((gained - spent).sum(axis=1))
        assert np.allclose(left, recording.energy_j[1:, node], atol=1e-9 * max(left.max(), 1))


def test_json_brings_it_back(tmp_path, data):
    path = tmp_path / "episode.json"
    recording = Recording.from_json(data)
    recording.save(path)
    found = Recording.load(path)
    assert same(found, recording) == {}
    for name, value in vars(recording).items():
        assert getattr(getattr(found, name), "dtype", None) == getattr(value, "dtype", None)
    (tmp_path / "scenario.yaml").write_text(found.scenario_yaml)
    scenario = iout_marl.load_scenario(tmp_path / "scenario.yaml")
    assert scenario.hash == found.scenario_hash == iout_marl.load_scenario("multi/m2-k10-fdd").hash


def test_cells_that_are_no_cubes_are_brought_back(tmp_path):
    flat = {"grid.spacing_m": [90, 120, 30], "episode.duration_s": 600}
    recording = record_policy("paper/k3-fdd", "greedy", overrides=flat)
    recording.save(tmp_path / "episode.json")
    found = Recording.load(tmp_path / "episode.json")
    assert found.spacing_m == recording.spacing_m == (90, 120, 30)
    assert found.snapshot(0).edges_m == (90, 120, 30)
    trajectory = Trajectory.from_recording(found)
    assert Trajectory(**json.loads(json.dumps(trajectory.to_json()))) == trajectory


def test_stores_with_limits_have_their_capacity_and_nodes_that_sleep(tmp_path):
    storage = {"kind": "capacitor", "capacity_j": 300.0, "idle_w": 0.5}
    recording = record_policy("paper/k5-fdd", "random-walk", overrides={"storage": storage})
    assert "asleep" in {reason.code for reason in recording.reasons}
    recording.save(tmp_path / "e.json")
    again = Recording.load(tmp_path / "e.json")
    assert again.capacity_j == 300
    assert not same(recording, again)
    snapshot = again.snapshot(3)
    assert snapshot.energy_yardstick_j == 300
    assert snapshot.yardstick_text == "the capacity of a store"
    assert render_page([again]).count("full at 300 J, the capacity of a store") == 1


def test_batteries_are_recorded_and_shown(tmp_path):
    overrides = {"vehicle": {**BATTERY, "capacity_j": 3e5}}
    recording = record_policy("paper/k5-fdd", "random-walk", overrides=overrides)
    assert "stranded" in {reason.code for reason in recording.reasons}
    recording.save(tmp_path / "e.json")
    again = Recording.load(tmp_path / "e.json")
    assert again.battery.shape == (again.slots + 1, 1)
    assert again.battery[0, 0] == 0.6
    assert again.battery[-1, 0] == 0
    assert not same(recording, again)
    assert "battery 60%" in as_text(again.snapshot(0))
    assert "battery empty" in as_text(again.snapshot(again.slots))
    assert '"battery":' in render_page([again])


SEA = {
    "episode.slot_s": 10,
    "auvs.count": 2,
    "vehicle": {**BATTERY, **DOCKS, "capacity_j": 3e5},
    "storage": {"kind": "capacitor", "capacity_j": 300.0, "idle_w": 0.5},
}


@pytest.fixture(scope="module")
def sea():
    return record_policy("paper/k5-fdd", "random-walk", 1, overrides=SEA)


def test_moves_docks_and_sleep_are_kept(sea, tmp_path):
    sea.save(tmp_path / "e.json")
    again = Recording.load(tmp_path / "e.json")
    assert not same(sea, again)
    # 25 s for a cell: three slots.
    assert set(np.unique(again.transit_slots)) == {0, 1, 2}
    assert set(np.unique(progress(again.transit_slots).round(3))) == {0, 0.333, 0.667}
    way = again.positions() - again.path
    assert ((way != 0).any(axis=-1) == (again.transit_slots > 0)).all()
    assert np.abs(np.diff(again.positions(only_arriving=True), axis=0)).max() < 1 / 3 + 1e-9
    assert again.docks.tolist() == DOCKS["docks"]
    assert again.asleep.any(axis=0).all()
    assert again.stranded.any()
    assert not again.asleep.all()


@pytest.mark.slow
def test_a_snapshot_of_the_sea_is_that_of_the_world(sea):
    world, docked = World("paper/k5-fdd", overrides=SEA), 0
    for place, (state, events) in enumerate(play(world, make_baseline("random-walk"), 1)):
        expected, found = Snapshot.from_world(world, state, events), sea.snapshot(place)
        for name in ("headings", "transit_slots", "docks", "stranded", "asleep", "battery"):
            assert np.array_equal(getattr(found, name), getattr(expected, name)), name
        assert found.progress == pytest.approx(expected.progress)
        assert found.auv_places == pytest.approx(sea.positions()[place])
        docked += found.docked.sum()
        text, words = as_text(found), [found.condition(auv) for auv in range(2)]
        assert all(word in text for word in words)
        assert text.count("asleep") == (0 if found.asleep is None else found.asleep.sum())
        assert len(re.findall(r" to \d+,\d+,\d+ in \d slots?", text)) == found.under_way.sum()
    assert docked > 0


def test_the_trajectory_has_docks_and_ages_of_less_than_a_slot():
    vehicle = {**BATTERY, **DOCKS, "capacity_j": 5e6}
    changes = {"age.sampling": "packet_start", "vehicle": vehicle}
    recording = record_policy("paper/k5-tdd", "greedy", 1, overrides=changes)
    assert (recording.ages % 1).any()
    drawn = Trajectory.from_recording(recording)
    assert drawn.docks == DOCKS["docks"]
    assert np.array(drawn.ages) == pytest.approx(recording.ages[1:], abs=1e-3)
    kept = json.loads(json.dumps(drawn.to_json()))
    assert Trajectory(**kept) == drawn


def test_a_move_that_is_stopped_leads_nowhere():
    changes = {
        "grid.cells": [2, 2, 1],
        "auvs": {"count": 2, "start_cells": [[1, 1, 1], [2, 2, 1]]},
        "nodes.cells": [[1, 1, 1], [1, 2, 1], [2, 1, 1]],
        "episode.slot_s": 10,
    }
    recording = record_policy("paper/k3-fdd", "random-walk", overrides=changes)
    under_way = recording.transit_slots > 0
    leads = arrives(recording.path, recording.heading, recording.transit_slots)
    assert 0 < (under_way & ~leads).sum() < under_way.sum()
    for slot, auv in np.argwhere(recording.blocked):
        assert not leads[slot, auv] or not under_way[slot, auv]


def test_recordings_of_before_know_nothing_of_it(data):
    older = Recording.from_json(data)
    assert older.heading is older.transit_slots is older.docks is older.asleep is None
    assert older.positions().tolist() == older.path.tolist()
    with pytest.raises(InputError, match="transit_slots is missing, but heading is there"):
        Recording.from_json({**data, "heading": data["path"]})
    with pytest.raises(InputError, match="heading is missing, but transit_slots is there"):
        Recording.from_json({**data, "transit_slots": [[0]] * len(data["path"])})
    with pytest.raises(InputError, match=r"docks\[1, 2\] is out of range: 99"):
        Recording.from_json({**data, "docks": [[1, 99, 1]]})


def test_without_batteries_none_is_recorded(data):
    assert "battery" not in data
    assert Recording.from_json(data).battery is None
    wide = np.full((len(data["ages"]), len(data["path"][0])), 1.5).tolist()
    with pytest.raises(InputError, match=r"battery\[1, 1\] is out of range: 1.5"):
        Recording.from_json({**data, "battery": wide})
    with pytest.raises(InputError, match="battery must be "):
        Recording.from_json({**data, "battery": [[1.0]]})


def test_how_ages_are_taken_is_written_where_it_is_over_time(data):
    assert "ages_over_time" not in data
    assert Recording.from_json(data).ages_over_time is False
    overrides = {"age.sampling": "packet_start"}
    written = record_policy("paper/k3-fdd", "greedy", 0, overrides=overrides).to_json()
    assert Recording.from_json(written).ages_over_time is True
    with pytest.raises(InputError, match="ages_over_time must be true or false, not 'no'"):
        Recording.from_json({**data, "ages_over_time": "no"})


def test_stores_without_limits_have_none(data):
    assert "capacity_j" not in data
    assert Recording.from_json(data).capacity_j is None
    with pytest.raises(InputError, match="capacity_j must be a number above 0, not 0"):
        Recording.from_json({**data, "capacity_j": 0})


def test_trajectory_is_a_part_of_it():
    found = iout_marl.record_episode("best/k5-tdd", "greedy")
    recording = record_policy("best/k5-tdd", "greedy")
    assert found == Trajectory.from_recording(recording)
    only_charged = recording.beta == 1
    assert only_charged.any()
    assert np.array_equal(np.array(found.heard) == 0, only_charged)
    assert np.array_equal(np.array(found.charged) == 0, recording.beta == 0)


def own_loop(env, seed):
    env.reset(seed=seed)
    rng = np.random.default_rng(seed)
    while env.agents:
        env.step({a: rng.integers(0, env.action_space(a).nvec) for a in env.agents})
    return env.recording


@pytest.mark.slow
@pytest.mark.parametrize("scenario", [*SCENARIOS, "multi/m4-k10-fdd"])
def test_ones_own_loop_is_recorded(scenario):
    """A single environment, number by number or by arrays, plays what the world does."""
    recording = own_loop(record(iout_v0.parallel_env(scenario), "mine"), 5)
    assert (recording.policy, recording.seed) == ("mine", 5)
    world, rng = World(scenario), np.random.default_rng(5)
    state = world.reset(seed=5)
    for slot in range(world.num_slots):
        action = [rng.integers(0, world.action_sizes) for _ in range(world.num_auvs)]
        state, events = world.step(state, np.array([action]))
        assert np.array_equal(recording.ages[slot + 1], state.age[0])
        assert np.allclose(recording.energy_j[slot + 1], state.energy_j[0], rtol=1e-12)
        assert np.array_equal(recording.delivered[slot], events.delivered[0])


def test_joint_environment_is_recorded_within_wrappers():
    inner = gymnasium.make("iout_marl:AUV-v0", scenario="multi/m2-k10-fdd")
    env = record(gymnasium.wrappers.RecordEpisodeStatistics(inner))
    env.reset(seed=2)
    for _ in range(3):
        env.step(env.action_space.sample())
    assert (env.recording.slots, env.recording.num_slots) == (3, 100)
    first = env.recording
    env.reset()
    env.step(env.action_space.sample())
    assert (env.recording.slots, first.slots) == (1, 3), "a reset begins anew"


def test_what_cannot_be_recorded():
    for env in (iout_v0.env("paper/k3-fdd"), gymnasium.make("CartPole-v1"), None):
        with pytest.raises(InputError, match=r"^env: must be iout_v0\.parallel_env"):
            record(env)
    env = record(iout_v0.parallel_env("paper/k3-fdd"))
    with pytest.raises(RuntimeError, match="has not begun"):
        _ = env.recording
    env.reset()
    with pytest.raises(RuntimeError, match="no slot has been played"):
        _ = env.recording


def test_numbers_without_bounds_are_refused():
    world = World("paper/k3-fdd")
    (first, _), (state, events), *_ = play(world, make_baseline("greedy"))
    recorder = Recorder(world, first, "greedy")
    recorder.add(events, state._replace(energy_j=state.energy_j + np.inf))
    with pytest.raises(InputError, match="paper/k3-fdd: energy_j has numbers that are too large"):
        recorder.recording()


def changed(data, key, value):
    wrong = copy.deepcopy(data)
    *way, last = key.split(".")
    part = wrong
    for step in way:
        part = part[int(step) if step.isdigit() else step]
    part[int(last) if last.isdigit() else last] = value
    return wrong


FAULTS = {
    "format": ("something", "is no recording, as `Recording.save` writes it"),
    "version": (2, "version must be 1, not 2: record the episode anew"),
    "scenario": (3, "scenario must be a text, not 3"),
    "seed": (-1, "seed must be a whole number or null, not -1"),
    "grid": ([10, 10], "grid must be three numbers of cells, not [10, 10]"),
    "grid.1": (0, "grid must be three numbers of cells, not [10, 0, 4]"),
    "splits_slot": (1, "splits_slot must be true or false, not 1"),
    "spacing_m": ([100, 20], "spacing_m must be a number above 0 or three, not [100, 20]"),
    "slot_s": ("20", "slot_s must be a number above 0, not '20'"),
    "maximum_age": (-1, "maximum_age must be a number from 0, not -1"),
    "num_slots": (20, "charged must have at most 20 slots"),
    "reasons": ([["lost"]], "reasons must be pairs of code and text, not [['lost']]"),
    "reasons.0.0": ("No Word", "reasons reason 'No Word': a code is a word"),
    "charged": ([], "charged must be a list that is not empty, not []"),
    "charged.0": (1, "charged must hold lists that are not empty, not 1"),
    "charged.3.1": (11, "charged[4, 2] is out of range: 11"),
    "heard.3.1": (-1, "heard[4, 2] is out of range: -1"),
    "heard.3": ([1, 2, 3], "heard must be 100 × 2 (slots, auvs) of whole numbers"),
    "heard.3.0": (1.5, "heard must be 100 × 2 (slots, auvs) of whole numbers"),
    "outcome.0.0": (9, "outcome[1, 1] is out of range: 9"),
    "path.0.0.2": (9, "path[1, 1, 3] is out of range: 9"),
    "path.0": ([[1, 1, 1]], "path must be 101 × 2 × 3 (slots + 1, auvs, axes) of whole numbers"),
    "left_grid.0.0": (1, "left_grid must be 100 × 2 (slots, auvs) of true and false"),
    "beta.0.0": (1.5, "beta[1, 1] is out of range: 1.5"),
    "ages.5.2": ("old", "ages must be 101 × 10 (slots + 1, nodes) of numbers"),
    "energy_j.5.2": (-1.0, "energy_j[6, 3] is out of range: -1.0"),
}


def test_slots_of_no_length_are_refused(data):
    with pytest.raises(InputError, match=r"num_slots must be a whole number from 1, not 100.5$"):
        Recording.from_json({**data, "num_slots": 100.5})
    with pytest.raises(InputError, match=r"slot_s must be a number above 0, not 0$"):
        Recording.from_json({**data, "slot_s": 0})


@pytest.mark.parametrize("key", FAULTS)
def test_faults_of_a_file_are_named(tmp_path, data, key):
    value, message = FAULTS[key]
    path = tmp_path / "episode.json"
    path.write_text(json.dumps(changed(data, key, value)))
    with pytest.raises(InputError) as raised:
        Recording.load(path)
    assert str(raised.value).startswith(f"{path}: {message}")


@pytest.mark.parametrize("key", ["policy", "seed", "energy_j", "reasons"])
def test_what_a_file_lacks_is_named(data, key):
    wrong = {name: value for name, value in data.items() if name != key}
    with pytest.raises(InputError, match=f"^recording: {key} is missing$"):
        Recording.from_json(wrong)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "damaged, it is no JSON"),
        ('{"format": NaN}', "NaN is no number of JSON"),
        ("[1, 2]", "is no recording"),
    ],
    ids=["empty", "nan", "list"],
)
def test_other_files_are_refused(tmp_path, text, message):
    path = tmp_path / "episode.json"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        Recording.load(path)
    with pytest.raises(InputError, match="cannot be read: No such file"):
        Recording.load(tmp_path / "nothing.json")
