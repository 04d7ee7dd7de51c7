"""Mission items of MAVLink, which two formats write."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from iout_marl.mission.legs import Leg

#: MAV_CMD: fly to a waypoint, stay there for a time, change a speed.
WAYPOINT, LOITER_TIME, CHANGE_SPEED = 16, 19, 178
#: MAV_FRAME: altitude above home, which lies at the surface; none at all.
RELATIVE, MISSION = 3, 2
#: SPEED_TYPE, the first parameter of CHANGE_SPEED.
GROUND, CLIMB, DESCENT = 1, 2, 3
#: Autopilots keep stays as 16-bit numbers of seconds.
MAX_HOLD_S = 65_535


@dataclass(frozen=True)
class Item:
    """A mission item.

    Attributes:
        command: MAV_CMD.
        frame: MAV_FRAME.
        first, second, third: its parameters 1 to 3; the fourth, yaw, is left open.
        position: latitude and longitude in degrees, altitude in m; None where it has none.
    """

    command: int
    frame: int
    first: float = 0.0
    second: float = 0.0
    third: float = 0.0
    position: tuple[float, float, float] | None = None


def items(legs: list[Leg]) -> Iterator[Item]:
    """The items of a route, each speed before the first run that has it."""
    speeds: dict[int, float] = {}
    for leg in legs:
        latitude, longitude, depth = leg.point
        position = (latitude, longitude, 0.0 - depth)
        rising = CLIMB if leg.down_m_per_s < 0 else DESCENT
        for kind, speed in ((GROUND, leg.horizontal_m_per_s), (rising, abs(leg.down_m_per_s))):
            if speed and speeds.get(kind) != speed:
                speeds[kind] = speed
                yield Item(CHANGE_SPEED, MISSION, kind, speed, -1.0)
        yield Item(WAYPOINT, RELATIVE, position=position)
        left_s = int(leg.hold_s)
        while left_s:
            seconds = min(left_s, MAX_HOLD_S)
            left_s -= seconds
            yield Item(LOITER_TIME, RELATIVE, seconds, position=position)
