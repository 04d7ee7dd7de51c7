"""Plans of IMC, the messages of Neptus and DUNE, as JSON.

Fields, types and units are those of `IMC.xml` (LSTS/imc): PlanSpecification (551) of PlanManeuver
(552) and PlanTransition (553); Goto (450), StationKeeping (461).
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

from iout_marl.files import to_json
from iout_marl.mission.formats.base import Format, title
from iout_marl.mission.legs import Leg, geodetic_legs
from iout_marl.mission.mission import Mission
from iout_marl.mission.route import Route

#: ZUnits DEPTH, SpeedUnits METERS_PS, and the angle of a Goto that says nothing.
_DEPTH, _METRES_PER_SECOND, _OPEN = 1, 0, -1
#: Times are 16-bit numbers of seconds.
_MAX_S = 65_535
#: How near a vehicle that stays keeps to its place, in m.
_STAY_RADIUS_M = 5.0


def _text(mission: Mission, route: Route) -> str:
    maneuvers = []
    for i, leg in enumerate(geodetic_legs(route, mission.place), start=1):
        maneuvers.append(_maneuver(f"goto-{i}", _goto(leg, mission)))
        left_s, part = int(leg.hold_s), 0
        while left_s:
            seconds, part = min(left_s, _MAX_S), part + 1
            left_s -= seconds
            maneuvers.append(_maneuver(f"stay-{i}-{part}", _stay(leg, mission, seconds)))
    names = [maneuver["maneuver_id"] for maneuver in maneuvers]
    plan = {
        "abbrev": "PlanSpecification",
        "timestamp": mission.start.timestamp(),
        "plan_id": f"auv-{route.auv}",
        "description": title(mission, route),
        "vnamespace": "",
        "variables": [],
        "start_man_id": names[0],
        "maneuvers": maneuvers,
        "transitions": [
            {
                "abbrev": "PlanTransition",
                "source_man": source,
                "dest_man": target,
                "conditions": "ManeuverIsDone",
                "actions": [],
            }
            for source, target in pairwise(names)
        ],
        "start_actions": [],
        "end_actions": [],
    }
    return to_json(plan, indent=2)


def _maneuver(name: str, data: dict[str, Any]) -> dict[str, Any]:
    return {
        "abbrev": "PlanManeuver",
        "maneuver_id": name,
        "data": data,
        "start_actions": [],
        "end_actions": [],
    }


def _place(leg: Leg, mission: Mission) -> dict[str, Any]:
    latitude, longitude, depth = leg.point
    return {
        "lat": math.radians(latitude),
        "lon": math.radians(longitude),
        "z": depth,
        "z_units": _DEPTH,
        "speed": leg.speed_m_per_s or mission.speed_m_per_s,
        "speed_units": _METRES_PER_SECOND,
        "custom": "",
    }


def _goto(leg: Leg, mission: Mission) -> dict[str, Any]:
    # A vehicle may be slow, and the way to the start is not known.
    timeout_s = min(_MAX_S, math.ceil(2 * leg.run_s + 600))
    angles = {"roll": _OPEN, "pitch": _OPEN, "yaw": _OPEN}
    return {"abbrev": "Goto", "timeout": timeout_s, **_place(leg, mission), **angles}


def _stay(leg: Leg, mission: Mission, seconds: int) -> dict[str, Any]:
    own = {"radius": _STAY_RADIUS_M, "duration": seconds}
    return {"abbrev": "StationKeeping", **own, **_place(leg, mission)}


FORMAT = Format(
    name="imc",
    suffix=".imc.json",
    reader="Neptus and DUNE, through IMC",
    needs_origin=True,
    has_times=False,
    text=_text,
)
