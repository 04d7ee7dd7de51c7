"""GeoJSON (RFC 7946), in WGS-84; the third coordinate is the height, minus the depth, in m."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np

from iout_marl.core.geography import Floats
from iout_marl.files import to_json
from iout_marl.mission.formats.base import Format, title
from iout_marl.mission.legs import DEGREE_DIGITS, METRE_DIGITS
from iout_marl.mission.mission import Mission
from iout_marl.mission.route import Route

#: Seconds since the start, latitude and longitude in degrees, depth in m.
Point: TypeAlias = tuple[float, float, float, float]


def _text(mission: Mission, route: Route) -> str:
    places = mission.place.geodetic(route.local).tolist()
    parts = cut_at_antimeridian([(seconds, *places[i]) for seconds, i in route.moments()])
    lines = [[_coordinates(place) for _, *place in part] for part in parts]
    times = [[mission.at(seconds) for seconds, *_ in part] for part in parts]
    # A line that is one has its times in one list, a line in parts those of each part in its own.
    is_whole = len(parts) == 1
    line = {
        "type": "LineString" if is_whole else "MultiLineString",
        "coordinates": lines[0] if is_whole else lines,
    }
    track = {"title": title(mission, route), "auv": route.auv}
    track["coordTimes"] = times[0] if is_whole else times
    features = [_feature(line, kind="track", **track)]
    for i, waypoint in enumerate(route.waypoints):
        features.append(
            _feature(
                _point(places[i]),
                kind="waypoint",
                auv=route.auv,
                waypoint=i + 1,
                time=mission.at(waypoint.arrival_s),
                hold_s=waypoint.hold_s,
                depth_m=waypoint.local[2],
                speed_m_per_s=waypoint.speed_m_per_s,
            )
        )
    nodes = mission.place.geodetic(mission.place.local(mission.node_cells)).tolist()
    for number, node in enumerate(nodes, start=1):
        features.append(_feature(_point(node), kind="node", node=number, depth_m=node[2]))
    return to_json({"type": "FeatureCollection", "features": features}, indent=2)


def cut_at_antimeridian(points: Sequence[Point]) -> list[list[Point]]:
    """A line in parts that do not cross 180° of longitude (RFC 7946, 3.1.9).

    Args:
        points: seconds, latitude, longitude and depth of two points or more. Between two of them
            the line goes the shorter way around the Earth, at an even speed.

    Returns:
        the parts; where one ends at 180° the next begins at -180°, and the other way round.
    """
    line = np.array(points)
    line[:, 2] = np.unwrap(line[:, 2], period=360)  # beyond 180° it goes on
    parts: list[list[Point]] = []
    around = 0
    for start, end in pairwise(line):
        for first, second in pairwise([start, *_crossing(start, end), end]):
            turns = round((first[2] + second[2]) / 720)
            if not parts or turns != around:
                parts.append([_turned_back(first, turns)])
            around = turns
            parts[-1].append(_turned_back(second, turns))
    return parts


def _crossing(start: Floats, end: Floats) -> list[Floats]:
    """The point between two others at which a line crosses the antimeridian, if it does."""
    west, east = sorted((start[2], end[2]))
    meridian = 360 * np.floor((east + 180) / 360) - 180
    if not west < meridian < east:
        return []
    return [start + (end - start) * (meridian - start[2]) / (end[2] - start[2])]


def _turned_back(point: Floats, turns: int) -> Point:
    seconds, latitude, longitude, depth = point.tolist()
    return seconds, latitude, longitude - 360 * turns, depth


def _feature(geometry: dict[str, Any], **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _point(place: list[float]) -> dict[str, Any]:
    return {"type": "Point", "coordinates": _coordinates(place)}


def _coordinates(place: list[float]) -> list[float]:
    latitude, longitude, depth = place
    degrees = round(longitude, DEGREE_DIGITS), round(latitude, DEGREE_DIGITS)
    return [*degrees, round(0.0 - depth, METRE_DIGITS)]


FORMAT = Format(
    name="geojson",
    suffix=".geojson",
    reader="maps",
    needs_origin=True,
    has_times=True,
    text=_text,
)
