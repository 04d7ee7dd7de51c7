"""GPX 1.1: a track with times; elevations are minus the depth, in m. Nodes are its waypoints."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from iout_marl.mission.formats.base import Format, title
from iout_marl.mission.formats.xml_file import add, degrees, document, height
from iout_marl.mission.mission import Mission
from iout_marl.mission.route import Route

_ATTRIBUTES = {
    "version": "1.1",
    "creator": "iout_marl",
    "xmlns": "http://www.topografix.com/GPX/1/1",
}


def _text(mission: Mission, route: Route) -> str:
    root = ET.Element("gpx", _ATTRIBUTES)
    nodes = mission.place.geodetic(mission.place.local(mission.node_cells)).tolist()
    for number, node in enumerate(nodes, start=1):
        add(_point(root, "wpt", node), "name", f"node {number}")
    track = add(root, "trk")
    add(track, "name", title(mission, route))
    segment = add(track, "trkseg")
    places = mission.place.geodetic(route.local).tolist()
    for seconds, i in route.moments():
        add(_point(segment, "trkpt", places[i]), "time", mission.at(seconds))
    return document(root)


def _point(parent: ET.Element, kind: str, place: list[float]) -> ET.Element:
    latitude, longitude, depth = place
    point = add(parent, kind, lat=degrees(latitude), lon=degrees(longitude))
    add(point, "ele", height(depth))
    return point


FORMAT = Format(
    name="gpx",
    suffix=".gpx",
    reader="chart plotters",
    needs_origin=True,
    has_times=True,
    text=_text,
)
