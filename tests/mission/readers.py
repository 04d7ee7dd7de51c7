"""Reads mission files as others do: what a file says, as points with their times.

Every reader returns (seconds since the start, latitude, longitude, depth) of each moment at which
the vehicle arrives or leaves; where a format has no times, they follow from speeds and stays.
"""

import csv
import json
import math
import re
from datetime import datetime
from itertools import pairwise

import numpy as np
from pyproj import Geod

WGS84 = Geod(ellps="WGS84")


def seconds(text, start):
    moment = datetime.fromisoformat(text) if isinstance(text, str) else text
    return (moment - start).total_seconds()


def read_kml(path, start):
    from fastkml import kml
    from fastkml.gx import Track
    from fastkml.utils import find

    whole = kml.KML.parse(path, strict=True, validate=False)
    track = find(whole, of_type=Track)
    return [
        (seconds(item.when.dt, start), item.coord.y, item.coord.x, -item.coord.z)
        for item in track.track_items
    ]


def read_gpx(path, start):
    import gpxpy

    (track,) = gpxpy.parse(path.read_text(), version="1.1").tracks
    (segment,) = track.segments
    return [(seconds(p.time, start), p.latitude, p.longitude, -p.elevation) for p in segment.points]


def read_geojson(path, start):
    import geojson

    whole = geojson.loads(path.read_text())
    assert isinstance(whole, geojson.FeatureCollection)
    assert whole.is_valid, whole.errors()
    track = whole.features[0]
    lines, times = track.geometry.coordinates, track.properties["coordTimes"]
    if track.geometry.type == "LineString":
        lines, times = [lines], [times]
    parts = [
        [
            (seconds(when, start), latitude, longitude, -height)
            for when, (longitude, latitude, height) in zip(*part, strict=True)
        ]
        for part in zip(times, lines, strict=True)
    ]
    for part in parts:
        assert np.abs(np.diff([longitude for _, _, longitude, _ in part])).max() < 180
    for (*_, (*first, west, depth)), ((*second, east, other), *_) in pairwise(parts):
        # A part begins where and when the one before has ended, on the other side.
        assert {west, east} == {-180, 180}
        assert (first, depth) == (second, other)
    # A cut is no place where the vehicle turns, stays, begins or ends.
    return [
        point
        for number, part in enumerate(parts)
        for point in part[number > 0 : len(part) - (number < len(parts) - 1)]
    ]


def read_csv(path, start):
    points = []
    for row in csv.DictReader(path.read_text().splitlines()):
        place = [float(row[key]) for key in ("latitude_deg", "longitude_deg", "depth_m")]
        when, hold_s = seconds(row["time_utc"], start), float(row["hold_s"])
        assert abs(when - float(row["time_s"])) < 0.002
        points.append((when, *place))
        if hold_s:
            points.append((when + hold_s, *place))
    return points


def read_plan(path, _):
    """As QGroundControl does: what it requires must be there."""
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    whole = json.loads(path.read_text())
    assert (whole["fileType"], whole["version"]) == ("Plan", 1)
    assert {"groundStation", "geoFence", "rallyPoints"} <= whole.keys()
    mission = whole["mission"]
    assert mission["version"] == 2
    assert mission["firmwareType"] == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
    assert mission["vehicleType"] == mavlink.MAV_TYPE_SUBMARINE
    assert mission["cruiseSpeed"] > 0
    assert mission["hoverSpeed"] > 0
    assert mission["globalPlanAltitudeMode"] == 1
    items = mission["items"]
    assert [item["doJumpId"] for item in items] == list(range(1, len(items) + 1))
    for item in items:
        assert item["type"] == "SimpleItem"
        assert item["autoContinue"] is True
        assert len(item["params"]) == 7
        expected = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
        if item["command"] == mavlink.MAV_CMD_DO_CHANGE_SPEED:
            expected = mavlink.MAV_FRAME_MISSION
        assert item["frame"] == expected
    latitude, longitude, altitude = mission["plannedHomePosition"]
    assert items[0]["params"][4:6] == [latitude, longitude]
    assert altitude == 0
    return flown([(item["command"], *item["params"]) for item in items])


def read_wpl(path, _):
    from pymavlink import mavwp

    loader = mavwp.MAVWPLoader()
    loader.load(str(path))
    found = [loader.wp(i) for i in range(loader.count())]
    assert [item.seq for item in found] == list(range(len(found)))
    assert [item.current for item in found] == [1, *[0] * (len(found) - 1)]
    home, *items = found
    assert (home.frame, home.command, home.z) == (0, 16, 0)
    keys = ("command", "param1", "param2", "param3", "param4", "x", "y", "z")
    return flown([tuple(getattr(item, key) for key in keys) for item in items])


def flown(items):
    """The way that mission items lead, by the speeds across, up and down that they set."""
    speeds, points, now = {}, [], 0.0
    for command, first, second, _, _, latitude, longitude, altitude in items:
        if command == 178:
            speeds[{1: "across", 2: "up", 3: "down"}[int(first)]] = second
            continue
        place = (latitude, longitude, -altitude)
        if command == 16:
            now += leg_s(points[-1][1:], place, **speeds) if points else 0.0
        else:
            assert command == 19
            assert place == points[-1][1:]
            assert first == int(first) > 0
            now += first
        points.append((now, *place))
    return points


def leg_s(source, target, across=math.inf, up=math.inf, down=math.inf):
    distance_m = WGS84.inv(source[1], source[0], target[1], target[0])[2]
    deeper_m = target[2] - source[2]
    return max(distance_m / across, deeper_m / down if deeper_m > 0 else -deeper_m / up)


def read_imc(path, _):
    """By the messages of IMC itself, which know their fields, through their binary form."""
    import imcpy

    def message(data):
        made = getattr(imcpy, data["abbrev"])()
        for key, value in data.items():
            if isinstance(value, dict):
                setattr(made, key, message(value))
            elif isinstance(value, list):
                for each in value:
                    getattr(made, key).append(message(each))
            elif key == "z_units":
                made.z_units = imcpy.ZUnits(value)
            elif key == "speed_units":
                made.speed_units = imcpy.SpeedUnits(value)
            elif key != "abbrev":
                assert hasattr(made, key), key
                setattr(made, key, value)
        return made

    plan = imcpy.Packet.deserialize(message(json.loads(path.read_text())).serialize())
    assert isinstance(plan, imcpy.PlanSpecification)
    by_name = {maneuver.maneuver_id: maneuver.data for maneuver in plan.maneuvers}
    follows = {t.source_man: t.dest_man for t in plan.transitions}
    assert {t.conditions for t in plan.transitions} <= {"ManeuverIsDone"}
    name, points, now = plan.start_man_id, [], 0.0
    while name:
        data = by_name.pop(name)
        assert data.z_units == imcpy.ZUnits.DEPTH
        assert data.speed_units == imcpy.SpeedUnits.METERS_PS
        place = (math.degrees(data.lat), math.degrees(data.lon), data.z)
        if isinstance(data, imcpy.Goto):
            run_s = 0.0
            if points:
                source = points[-1][1:]
                across_m = WGS84.inv(source[1], source[0], place[1], place[0])[2]
                run_s = math.hypot(across_m, place[2] - source[2]) / data.speed
            assert run_s < data.timeout
            now += run_s
        else:
            assert isinstance(data, imcpy.StationKeeping)
            now += data.duration
        points.append((now, *place))
        name = follows.get(name)
    assert not by_name, "maneuvers that nothing leads to"
    return points


def read_moos(path, _):
    """As a helm runs it: (seconds, east, north, depth), one leg after the other."""
    text = path.read_text()
    blocks = [
        (kind, re.findall(r"(\w+)\s*= (.*)", body))
        for kind, body in re.findall(r"Behavior = (\w+)\n\{\n(.*?)\n\}", text, re.DOTALL)
    ]
    assert re.findall(r"^initialize +(.*)$", text, re.MULTILINE) == [
        "DEPLOY = false",
        "MISSION_LEG = 1",
    ]
    leg, points, now = 1, [], 0.0
    for (kind, across), (second_kind, down) in zip(blocks[::2], blocks[1::2], strict=True):
        for settings in (across, down):
            assert ("condition", f"MISSION_LEG = {leg}") in settings
        leg += 1
        assert ("endflag", f"MISSION_LEG = {leg}") in across
        assert second_kind == "BHV_ConstantDepth"
        own, depth = dict(across), float(dict(down)["depth"])
        x, y = map(float, (own.get("points") or own["station_pt"]).split(","))
        if kind == "BHV_Waypoint":
            distance_m = math.dist(points[-1][1:3], (x, y)) if points else 0.0
            now += distance_m / float(own["speed"])
        else:
            assert kind == "BHV_StationKeep"
            now += float(own["duration"])
        points.append((now, x, y, depth))
    return points


READERS = {
    "qgc-plan": read_plan,
    "wpl": read_wpl,
    "imc": read_imc,
    "moos": read_moos,
    "geojson": read_geojson,
    "kml": read_kml,
    "gpx": read_gpx,
    "csv": read_csv,
}
