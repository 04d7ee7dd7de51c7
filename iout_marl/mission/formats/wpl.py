"""Waypoint lists, `QGC WPL 110`, of MAVProxy and Mission Planner."""

from __future__ import annotations

from iout_marl.mission.formats.base import Format
from iout_marl.mission.formats.mavlink import WAYPOINT, Item, items
from iout_marl.mission.legs import DEGREE_DIGITS, METRE_DIGITS, SPEED_DIGITS, geodetic_legs
from iout_marl.mission.mission import Mission
from iout_marl.mission.route import Route

#: MAV_FRAME of home: altitude above the sea.
_GLOBAL = 0


def _text(mission: Mission, route: Route) -> str:
    legs = geodetic_legs(route, mission.place)
    latitude, longitude, _ = legs[0].point
    # The first item is home.
    home = Item(WAYPOINT, _GLOBAL, position=(latitude, longitude, 0.0))
    lines = ["QGC WPL 110", *(_line(i, item) for i, item in enumerate([home, *items(legs)]))]
    return "\n".join(lines)


def _line(number: int, item: Item) -> str:
    latitude, longitude, altitude = item.position or (0.0, 0.0, 0.0)
    parameters = (f"{value:.{SPEED_DIGITS}f}" for value in (item.first, item.second, item.third, 0))
    place = (
        f"{latitude:.{DEGREE_DIGITS}f}",
        f"{longitude:.{DEGREE_DIGITS}f}",
        f"{altitude:.{METRE_DIGITS}f}",
    )
    is_current = int(number == 0)
    return "\t".join(
        map(str, (number, is_current, item.frame, item.command, *parameters, *place, 1))
    )


FORMAT = Format(
    name="wpl",
    suffix=".waypoints",
    reader="MAVProxy, Mission Planner",
    needs_origin=True,
    has_times=False,
    text=_text,
)
