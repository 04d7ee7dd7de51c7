"""GeoJSON (RFC 7946), in WGS-84; the third coordinate is the height, minus the depth, in m."""

from __future__ import annotations

from typing import Any

from iout_marl.files import to_json
from iout_marl.mission.formats.base import Format, title
from iout_marl.mission.legs import DEGREE_DIGITS, METRE_DIGITS
from iout_marl.mission.mission import Mission
from iout_marl.mission.route import Route


def _text(mission: Mission, route: Route) -> str:
    places = mission.place.geodetic(route.local).tolist()
    moments = list(route.moments())
    track = {
        "title": title(mission, route),
        "auv": route.auv,
        "coordTimes": [mission.at(seconds) for seconds, _ in moments],
    }
    line = {"type": "LineString", "coordinates": [_coordinates(places[i]) for _, i in moments]}
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
