"""KML 2.2 with the track of Google's extension; altitudes are minus the depth, in m."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from iout_marl.mission.formats.base import Format, title
from iout_marl.mission.formats.xml_file import add, degrees, document, height
from iout_marl.mission.mission import Mission
from iout_marl.mission.route import Route

_NAMESPACES = {
    "xmlns": "http://www.opengis.net/kml/2.2",
    "xmlns:gx": "http://www.google.com/kml/ext/2.2",
}


def _text(mission: Mission, route: Route) -> str:
    root = ET.Element("kml", _NAMESPACES)
    whole = add(root, "Document")
    add(whole, "name", title(mission, route))
    track = add(_placemark(whole, f"AUV {route.auv}"), "gx:Track")
    add(track, "altitudeMode", "absolute")
    places = mission.place.geodetic(route.local).tolist()
    moments = list(route.moments())
    for seconds, _ in moments:
        add(track, "when", mission.at(seconds))
    for _, i in moments:
        latitude, longitude, depth = places[i]
        add(track, "gx:coord", f"{degrees(longitude)} {degrees(latitude)} {height(depth)}")
    nodes = mission.place.geodetic(mission.place.local(mission.node_cells)).tolist()
    for number, (latitude, longitude, depth) in enumerate(nodes, start=1):
        point = add(_placemark(whole, f"node {number}"), "Point")
        add(point, "altitudeMode", "absolute")
        add(point, "coordinates", f"{degrees(longitude)},{degrees(latitude)},{height(depth)}")
    return document(root)


def _placemark(parent: ET.Element, name: str) -> ET.Element:
    placemark = add(parent, "Placemark")
    add(placemark, "name", name)
    return placemark


FORMAT = Format(
    name="kml",
    suffix=".kml",
    reader="Google Earth",
    needs_origin=True,
    has_times=True,
    text=_text,
)
