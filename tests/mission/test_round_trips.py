"""Every format is read back by its own tools: where vehicles are, and when."""

import csv
import json
import math
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from polling import polling
from pyproj import Proj
from readers import READERS

from iout_marl import InputError, iout_v0, load_scenario, record, record_episode, record_policy
from iout_marl.mission import (
    FORMATS,
    Mission,
    Place,
    Route,
    format_named,
    plan_mission,
    write_mission,
)
from iout_marl.mission.formats.geojson import cut_at_antimeridian
from iout_marl.mission.tables import actions_csv

START = datetime(2027, 5, 1, 8, tzinfo=UTC)
ORIGINS = {
    "porto": {"latitude_deg": 41.18, "longitude_deg": -8.7, "depth_m": 5, "bearing_deg": 30},
    "antimeridian": {"latitude_deg": -54.2, "longitude_deg": 179.9985, "bearing_deg": 20},
    "north": {"latitude_deg": 0, "longitude_deg": 0, "depth_m": 40.5},
}
SCENARIOS = {
    # Slots of 28.46… s, in which vehicles also stay, rise and dive.
    "hover": {
        "auvs": {"count": 2, "motion": "hover", "speed_m_per_s": 1.3},
        "grid.spacing_m": 37,
        "episode.duration_s": 4000,
    },
    # Slots shorter than the second that autopilots count in.
    "quick": {"auvs": {"motion": "hover"}, "grid.spacing_m": 1.5, "episode.duration_s": 60},
    # Layers that are dived through at an eighth of the speed.
    "flat": {
        "auvs": {"count": 2, "motion": "hover", "speed_m_per_s": 1.6},
        "grid.spacing_m": [60, 80, 10],
        "episode.duration_s": 4000,
    },
    # Moves over three slots, and over three cells in one.
    "short": {"auvs": {"count": 3, "motion": "hover"}, "episode.slot_s": 9.5},
    "long": {"auvs": {"count": 2, "motion": "hover"}, "episode.slot_s": 80},
    "tdd": {"duplex": {"kind": "tdd", "frequency_khz": 40}, "episode.duration_s": 1000},
}
CASES = [
    ("flat", "porto"),
    ("hover", "porto"),
    ("hover", "antimeridian"),
    ("quick", "north"),
    ("tdd", "north"),
    ("short", "porto"),
    ("long", "north"),
]


@pytest.fixture(scope="module", params=CASES, ids="-".join)
def planned(request):
    """A mission, and where each AUV is before and after each slot of its episode, in cells."""
    name, origin = request.param
    changes = {**SCENARIOS[name], "grid.origin": ORIGINS[origin]}
    scenario = load_scenario("paper/k3-fdd", changes)
    path = record_policy(scenario, "random-walk", 3).positions(only_arriving=True)
    return plan_mission(scenario, "random-walk", 3, START), path.swapaxes(0, 1)


def east_north(mission, cell):
    """Where a cell is, by what the scenario's keys say."""
    origin = mission.place.origin
    x, y, z = (np.array(cell) - 1) * mission.place.spacing_m
    bearing = math.radians(origin.bearing_deg)
    forward = (math.sin(bearing), math.cos(bearing))  # +y, clockwise from north
    right = (math.cos(bearing), -math.sin(bearing))
    east, north = (x * right[i] + y * forward[i] for i in (0, 1))
    return east, north, origin.depth_m + z


def plane(mission, points):
    """Latitudes and longitudes as metres to the east and north, by a projection of PROJ's."""
    origin = mission.place.origin
    projection = Proj(
        proj="aeqd", lat_0=origin.latitude_deg, lon_0=origin.longitude_deg, ellps="WGS84"
    )
    return [
        (s, *projection(longitude, latitude), depth) for s, latitude, longitude, depth in points
    ]


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMATS)
def test_vehicles_are_where_and_when_they_were_in_the_episode(name, planned, tmp_path):
    if name == "imc":
        pytest.importorskip("imcpy", reason="there are wheels for Linux only")
    mission, paths = planned
    chosen = format_named(name)
    write_mission(mission, [chosen], tmp_path)
    for route, path in zip(mission.routes, paths, strict=True):
        points = READERS[name](tmp_path / f"auv-{route.auv}{chosen.suffix}", START)
        if name != "moos":
            points = plane(mission, points)
        times, places = np.array(points)[:, 0], np.array(points)[:, 1:]
        assert (np.diff(times) >= 0).all()
        # Where it turns, stays, begins and ends.
        steps = np.diff(path, axis=0).round(9)
        turns = np.flatnonzero((steps[1:] != steps[:-1]).any(axis=1)) + 1
        slots = [0, *turns, len(steps)]
        if name in ("csv", "geojson", "gpx", "kml"):
            assert len(points) == len(slots)
        for slot in slots:
            near = np.linalg.norm(places - east_north(mission, path[slot]), axis=1) < 0.1
            assert abs(times[near] - slot * mission.slot_s).min() <= 1
        # Between these it goes straight: at the end of every slot it is in its cell.
        expected = np.array([east_north(mission, cell) for cell in path])
        ends = np.arange(len(path)) * mission.slot_s
        found = np.stack([np.interp(ends, times, places[:, i]) for i in range(3)], axis=1)
        error_m = np.linalg.norm(found - expected, axis=1).max()
        assert error_m <= (0.1 if chosen.has_times else mission.speed_m_per_s)


@pytest.mark.slow
def test_actions_are_those_of_the_episode(planned, tmp_path):
    mission, paths = planned
    write_mission(mission, [format_named("csv")], tmp_path)
    kept = json.loads((tmp_path / "actions.json").read_text())
    with (tmp_path / "actions.csv").open() as file:
        rows = list(csv.DictReader(file))
    empty = {None: "", True: "true", False: "false"}
    written = [
        {k: empty[v] if v is None or v is True or v is False else str(v) for k, v in action.items()}
        for action in kept["actions"]
    ]
    assert rows == written
    for action in kept["actions"]:
        cell = paths[action["auv"] - 1][action["slot"]]
        (place,) = plane(
            mission, [(0, *(action[k] for k in ("latitude_deg", "longitude_deg", "depth_m")))]
        )
        assert math.dist(place[1:], east_north(mission, cell)) < 0.01


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "policy", "changes"),
    [
        ("paper/k3-fdd", "greedy", {}),
        ("best/k3-tdd", "greedy", {}),
        ("paper/k3-fdd", "random-walk", {"auvs.idle_choices": True}),
        ("best/k3-tdd", "random-walk", {"auvs.idle_choices": True}),
    ],
)
def test_actions_say_whom_and_when(name, policy, changes):
    mission = plan_mission(name, policy, 0, START, overrides=changes)
    episode = record_episode(name, policy, 0, overrides=changes)
    idle = sum(not (c[0] or h[0]) for c, h in zip(episode.charged, episode.heard, strict=True))
    assert (idle > 0) == bool(changes)
    for slot in range(len(episode.charged)):
        own = {a.kind: a for a in mission.actions if a.slot == slot + 1}
        charged, heard = episode.charged[slot][0], episode.heard[slot][0]
        assert (own["charge"].node if "charge" in own else 0) == charged
        assert (own["hear"].node if "hear" in own else 0) == heard
        if heard:
            assert own["hear"].delivered is episode.delivered[slot][0]
        if not own:
            continue
        begins, ends = slot * mission.slot_s, (slot + 1) * mission.slot_s
        if "tdd" not in name:
            assert {(a.start_s, a.end_s) for a in own.values()} == {(begins, ends)}
            continue
        # One after the other, without a gap.
        parts = [(own[k].start_s, own[k].end_s) for k in ("charge", "hear") if k in own]
        assert parts[0][0] == begins
        assert parts[-1][1] == ends
        assert len(parts) == 1 or parts[0][1] == parts[1][0]
    assert any(a.kind == "hear" and a.delivered for a in mission.actions)


@pytest.mark.parametrize("name", ["paper/k5-fdd", "paper/k5-tdd"])
def test_actions_say_of_every_node_that_is_heard(name):
    scenario = load_scenario(name, polling(3, name, **{"charging.power_w": 8000}))
    recording = record_policy(scenario, "greedy", 0)
    mission = Mission.from_recording(recording, scenario, START)
    heard = [(a.slot - 1, a.node, a.delivered) for a in mission.actions if a.kind == "hear"]
    expected = [
        (slot, uplink.node, uplink.reason is None)
        for slot in range(recording.slots)
        for uplink in recording.uplinks(slot, 0)
        if not (recording.splits_slot and recording.beta[slot, 0] == 1)
    ]
    assert heard == expected
    assert len(heard) > recording.slots
    rows = actions_csv(mission).splitlines()
    assert sum(",hear," in row for row in rows) == len(heard)


def test_directions_on_earth_by_hand():
    """At 60° north a minute of longitude is half a sea mile, and 1000 m to the east are 0.0179°."""
    origin = {"latitude_deg": 60, "longitude_deg": 10, "depth_m": 7, "bearing_deg": 90}
    place = Place(load_scenario("paper/k3-fdd", {"grid.origin": origin}).grid)
    along_y = place.geodetic([(0.0, 1000.0, 7.0)])[0]
    assert along_y == pytest.approx([60, 10.017922, 7], abs=2e-6)
    along_x = place.geodetic([(1000.0, 0.0, 7.0)])[0]  # 90° to the right of east: south
    assert along_x == pytest.approx([59.991024, 10, 7], abs=2e-6)
    assert place.local((3, 2, 4)).tolist() == [200, 100, 307]


@pytest.mark.parametrize("origin", ORIGINS.values(), ids=ORIGINS)
def test_degrees_lead_back_to_metres(origin):
    place = Place(load_scenario("paper/k3-fdd", {"grid.origin": origin}).grid)
    local = np.random.default_rng(0).uniform(-9000, 9000, (50, 3))
    assert place.from_geodetic(place.geodetic(local)) == pytest.approx(local, abs=1e-6)
    cells = np.array([[1, 1, 1], [10, 3, 2], [4, 10, 4]])
    assert (place.cells(place.local(cells)) == cells).all()


def test_straight_runs_are_one_leg_and_a_long_stay_is_one_stay():
    place = Place(load_scenario("paper/k3-fdd").grid)
    cells = [(1, 1, 1), (2, 1, 1), (3, 1, 1), (3, 1, 1), (3, 1, 1), (3, 1, 2), (3, 1, 1)]
    route = Route.from_path(1, np.array(cells), place, 25.0)
    found = [(w.local, w.arrival_s, w.hold_s, w.speed_m_per_s) for w in route.waypoints]
    assert found == [
        ((0, 0, 0), 0, 0, 0),
        ((200, 0, 0), 50, 50, 4),
        ((200, 0, 100), 125, 0, 4),
        ((200, 0, 0), 150, 0, 4),
    ]


def test_a_move_over_several_slots_is_made_in_all_of_them():
    place = Place(load_scenario("paper/k3-fdd").grid)
    # Two cells of 25 s in slots of 10 s, a stay of one slot, and a cell across.
    xs = [1, 4 / 3, 5 / 3, 2, 7 / 3, 8 / 3, 3, 3, 3, 3, 3]
    ys = [1] * 8 + [4 / 3, 5 / 3, 2]
    route = Route.from_path(1, np.stack([xs, ys, np.ones(11)], axis=-1), place, 10.0)
    found = [(w.local, w.arrival_s, w.hold_s) for w in route.waypoints]
    assert found == [((0, 0, 0), 0, 0), ((200, 0, 0), 60, 10), ((200, 100, 0), 100, 0)]
    speeds = [w.speed_m_per_s for w in route.waypoints]
    assert speeds == pytest.approx([0, 10 / 3, 10 / 3])


#: AUVs are in one another's way.
SMALL = {
    "grid.cells": [3, 3, 2],
    "auvs": {"count": 2, "start_cells": [[1, 1, 1], [3, 3, 2]]},
    "nodes": {"kind": "fixed", "cells": [[2, 2, 1], [2, 2, 2], [1, 3, 1]]},
}


@pytest.mark.parametrize("slot_s", [10, 25, 60])
def test_plans_have_the_cruising_speed_whatever_the_length_of_a_slot(slot_s):
    changes = {"episode.slot_s": slot_s, **SMALL}
    episode = record_policy("paper/k3-fdd", "random-walk", 3, overrides=changes)
    mission = Mission.from_recording(episode, load_scenario("paper/k3-fdd", changes), START)
    slots_a_cell, cells_a_slot = math.ceil(25 / slot_s), max(slot_s // 25, 1)
    fastest = cells_a_slot * 100 / (slots_a_cell * slot_s)
    for auv, route in enumerate(mission.routes):
        runs = [waypoint.speed_m_per_s for waypoint in route.waypoints[1:]]
        assert max(runs) == pytest.approx(fastest)
        assert route.end_s == pytest.approx(episode.num_slots * slot_s)
        # Who arrives is there at the end of the slot in which it does.
        moments = np.array([(at, *route.local[i]) for at, i in route.moments()])
        for place, cell in enumerate(episode.path[:, auv]):
            if episode.transit_slots is None or not episode.transit_slots[place, auv]:
                where = [
                    np.interp(place * slot_s, moments[:, 0], axis) for axis in moments[:, 1:].T
                ]
                assert where == pytest.approx(100.0 * (cell - 1), abs=1e-6)
    assert (slot_s == 10) == (episode.transit_slots is not None)
    if slot_s == 10:
        given_up = episode.positions() != episode.positions(only_arriving=True)
        assert given_up.any(), "no move was stopped by another AUV"
        # Acts are where the vehicle is meant to be, under way between two cells.
        assert any(axis % 1 for action in mission.actions for axis in action.position)


def test_a_recorded_loop_of_ones_own_is_a_mission(tmp_path):
    env = record(iout_v0.parallel_env("paper/k3-fdd", overrides={"auvs.count": 2}))
    env.reset(seed=4)
    env.action_space("auv_0").seed(1)
    env.action_space("auv_1").seed(2)
    for _ in range(30):
        env.step({agent: env.action_space(agent).sample() for agent in env.agents})
    episode = env.recording
    mission = Mission.from_recording(episode, load_scenario("paper/k3-fdd"), START)
    assert [route.end_s for route in mission.routes] == [750, 750]
    assert {action.slot for action in mission.actions} == set(range(1, 31))
    write_mission(mission, [format_named("csv")], tmp_path)
    assert len((tmp_path / "actions.csv").read_text().splitlines()) == 1 + 2 * 2 * 30


OTHER_WORLDS = {
    "grid.cells": ("multi/m2-k10-fdd", {"grid.cells": [12, 10, 4]}),
    "grid.spacing_m": ("multi/m2-k10-fdd", {"grid.spacing_m": 50}),
    "slot_s": ("paper/k3-fdd", {"auvs.speed_m_per_s": 2}),
}


@pytest.mark.parametrize(("key", "other"), OTHER_WORLDS.items(), ids=OTHER_WORLDS)
def test_a_recording_is_no_mission_in_another_grid_or_time(key, other):
    name, changes = other
    episode = record_policy("paper/k3-fdd", "greedy", overrides={"episode.duration_s": 100})
    with pytest.raises(InputError, match=f"^scenario: {name} has {key} .*: give the scenario of"):
        Mission.from_recording(episode, load_scenario(name, changes), START)


@pytest.mark.slow
@pytest.mark.parametrize("start", [START, START + timedelta(microseconds=123_600)], ids=str)
@pytest.mark.parametrize("seconds", [0.0, 0.0019, 28.4615, 28.4616, 0.0045, 3599.9996])
def test_moments_are_rounded_as_seconds_are(seconds, start):
    mission = plan_mission("paper/k3-fdd", "greedy", 0, start)
    moment = datetime.fromisoformat(mission.at(seconds))
    ms = timedelta(milliseconds=1)
    expected = round((start - START) / ms) + round(round(seconds, 3) * 1000)
    assert (moment - START) / ms == expected


def test_a_mission_from_now_on_ends_while_there_are_dates():
    ages = {"auvs.speed_m_per_s": 1e-10, "episode.duration_s": 1e13}
    ages["allow_implausible"] = list(ages)
    with pytest.raises(InputError, match="would not lie within the years 1 to 9999"):
        plan_mission("paper/k3-fdd", "greedy", overrides=ages)


#: Longitudes of a line, and of its parts.
CUTS = {
    "not": ([179, 180, 179.5], [[179, 180, 179.5]]),
    "east": ([179, -179, -178], [[179, 180], [-180, -179, -178]]),
    "west": ([-179.5, 179, 178], [[-179.5, -180], [180, 179, 178]]),
    "there and back": ([179, -179, 179], [[179, 180], [-180, -179, -180], [180, 179]]),
    "through a point on it": ([179, 180, -179], [[179, 180], [-180, -179]]),
    "from a point on it": ([180, -179], [[-180, -179]]),
    "stay beyond": ([179, -179, -179], [[179, 180], [-180, -179, -179]]),
    "far from it": ([-1, 1, 0], [[-1, 1, 0]]),
}


@pytest.mark.parametrize(("line", "parts"), CUTS.values(), ids=CUTS)
def test_lines_are_cut_at_the_antimeridian(line, parts):
    points = [(10.0 * i, 2.0 * i, longitude, 5.0 + i) for i, longitude in enumerate(line)]
    found = cut_at_antimeridian(points)
    assert [[longitude for _, _, longitude, _ in part] for part in found] == parts
    # Time, latitude and depth go on evenly: a cut lies halfway between two points here.
    for seconds, latitude, _, depth in (point for part in found for point in part):
        assert (latitude, depth) == pytest.approx((seconds / 5, 5 + seconds / 10))
    assert {point[0] for part in found for point in part} >= {point[0] for point in points}


def test_tracks_over_the_antimeridian_are_cut(tmp_path):
    changes = {**SCENARIOS["hover"], "grid.origin": ORIGINS["antimeridian"]}
    mission = plan_mission(load_scenario("paper/k3-fdd", changes), "random-walk", 3, START)
    write_mission(mission, [format_named("geojson")], tmp_path)
    kinds = set()
    for route in mission.routes:
        track = json.loads((tmp_path / f"auv-{route.auv}.geojson").read_text())["features"][0]
        kinds.add(track["geometry"]["type"])
    assert "MultiLineString" in kinds
