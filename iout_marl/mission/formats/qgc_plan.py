"""Plans of QGroundControl, for ArduSub."""

from __future__ import annotations

from typing import Any

from iout_marl.files import to_json
from iout_marl.mission.formats.base import Format
from iout_marl.mission.formats.mavlink import LOITER_TIME, WAYPOINT, Item, items
from iout_marl.mission.legs import geodetic_legs
from iout_marl.mission.mission import Mission
from iout_marl.mission.route import Route

#: MAV_AUTOPILOT_ARDUPILOTMEGA and MAV_TYPE_SUBMARINE; altitudes relative to home.
_ARDUPILOT, _SUBMARINE, _RELATIVE = 3, 12, 1


def _text(mission: Mission, route: Route) -> str:
    legs = geodetic_legs(route, mission.place)
    latitude, longitude, _ = legs[0].point
    plan = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "geoFence": {"circles": [], "polygons": [], "version": 2},
        "rallyPoints": {"points": [], "version": 2},
        "mission": {
            "version": 2,
            "firmwareType": _ARDUPILOT,
            "vehicleType": _SUBMARINE,
            "cruiseSpeed": mission.speed_m_per_s,
            "hoverSpeed": mission.speed_m_per_s,
            "globalPlanAltitudeMode": _RELATIVE,
            "plannedHomePosition": [latitude, longitude, 0],
            "items": [_item(i, item) for i, item in enumerate(items(legs), start=1)],
        },
    }
    return to_json(plan, indent=2)


def _item(number: int, item: Item) -> dict[str, Any]:
    # No yaw is asked for: null.
    yaw = None if item.command == WAYPOINT else 0
    own = [item.first, item.second, item.third, yaw]
    place: dict[str, Any] = {}
    if item.position is not None and item.command in (WAYPOINT, LOITER_TIME):
        place = {
            "AMSLAltAboveTerrain": None,
            "Altitude": item.position[2],
            "AltitudeMode": _RELATIVE,
        }
    return {
        "type": "SimpleItem",
        "command": item.command,
        "frame": item.frame,
        "doJumpId": number,
        "autoContinue": True,
        "params": [*own, *(item.position or (0, 0, 0))],
        **place,
    }


FORMAT = Format(
    name="qgc-plan",
    suffix=".plan",
    reader="QGroundControl",
    needs_origin=True,
    has_times=False,
    text=_text,
)
