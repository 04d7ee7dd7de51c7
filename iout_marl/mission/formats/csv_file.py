"""Comma-separated waypoints: times, local metres, and where the grid is placed the degrees."""

from __future__ import annotations

from iout_marl.mission.formats.base import Format
from iout_marl.mission.legs import SECOND_DIGITS, SPEED_DIGITS
from iout_marl.mission.mission import Mission
from iout_marl.mission.route import Route
from iout_marl.mission.tables import located, table


def _text(mission: Mission, route: Route) -> str:
    places = located(mission.place, route.local)
    return table(
        [
            {
                "auv": route.auv,
                "waypoint": i,
                "time_s": round(waypoint.arrival_s, SECOND_DIGITS),
                "time_utc": mission.at(waypoint.arrival_s),
                "hold_s": round(waypoint.hold_s, SECOND_DIGITS),
                "speed_m_per_s": round(waypoint.speed_m_per_s, SPEED_DIGITS),
                **where,
            }
            for i, (waypoint, where) in enumerate(
                zip(route.waypoints, places, strict=True), start=1
            )
        ]
    )


FORMAT = Format(
    name="csv",
    suffix=".csv",
    reader="anything",
    needs_origin=False,
    has_times=True,
    text=_text,
)
