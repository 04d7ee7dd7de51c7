"""Behavior files of MOOS-IvP, in local metres to the east and north.

A behavior holds one depth, so each leg has its own: BHV_Waypoint across and BHV_ConstantDepth;
where a leg leads straight up or down, and for a stay, BHV_StationKeep for as long as that takes.
"""

from __future__ import annotations

from collections.abc import Iterator

from iout_marl.mission.formats.base import Format, title
from iout_marl.mission.legs import METRE_DIGITS, SPEED_DIGITS, Leg, local_legs
from iout_marl.mission.mission import Mission
from iout_marl.mission.route import Route

#: How near to a waypoint it counts as reached, as a part of the shortest edge of a cell.
_CAPTURE = 0.05
_LEG = "MISSION_LEG"


def _text(mission: Mission, route: Route) -> str:
    capture_m = _CAPTURE * float(mission.place.edges_m.min())
    origin = mission.place.origin
    where = (
        f"LatOrigin = {origin.latitude_deg!r}, LongOrigin = {origin.longitude_deg!r}"
        if origin
        else "nowhere on Earth: x and y of the grid are taken for east and north"
    )
    lines = [
        f"// {title(mission, route)}",
        f"// Metres to the east and north of {where}; depth in m, speed in m/s.",
        "initialize   DEPLOY = false",
        f"initialize   {_LEG} = 1",
    ]
    number = 0
    legs = local_legs(route, mission.place)
    for i, leg in enumerate(legs):
        for behavior in _behaviors(leg, mission, capture_m, is_start=i == 0):
            number += 1
            lines += ["", *_pair(number, leg, behavior)]
    return "\n".join(lines)


def _behaviors(
    leg: Leg, mission: Mission, capture_m: float, *, is_start: bool
) -> Iterator[list[tuple[str, str]]]:
    """What a leg does across: a run or the time that it takes up or down, and a stay."""
    x, y, _ = leg.point
    point = f"{x:.{METRE_DIGITS}f},{y:.{METRE_DIGITS}f}"
    if is_start or leg.horizontal_m_per_s:
        speed = leg.horizontal_m_per_s or mission.speed_m_per_s
        yield [
            ("Behavior", "BHV_Waypoint"),
            ("points", point),
            ("speed", f"{speed:.{SPEED_DIGITS}f}"),
            ("capture_radius", f"{capture_m:g}"),
            ("slip_radius", f"{3 * capture_m:g}"),
            ("repeat", "0"),
        ]
    else:
        yield _stay(point, leg.run_s, mission)
    if leg.hold_s:
        yield _stay(point, leg.hold_s, mission)


def _stay(point: str, seconds: float, mission: Mission) -> list[tuple[str, str]]:
    return [
        ("Behavior", "BHV_StationKeep"),
        ("station_pt", point),
        ("center_activate", "false"),
        ("transit_speed", f"{mission.speed_m_per_s:g}"),
        ("duration", f"{seconds:.{METRE_DIGITS}f}"),
        ("duration_idle_decay", "false"),
    ]


def _pair(number: int, leg: Leg, behavior: list[tuple[str, str]]) -> Iterator[str]:
    """The behavior across of a leg, which begins the next when it ends, and that of its depth."""
    (_, kind), *own = behavior
    when = [("condition", "DEPLOY = true"), ("condition", f"{_LEG} = {number}")]
    yield from _block(
        kind, [("name", f"leg_{number}"), *when, ("endflag", f"{_LEG} = {number + 1}"), *own]
    )
    depth = [("depth", f"{leg.point[2]:.{METRE_DIGITS}f}"), ("duration", "no-time-limit")]
    yield from _block("BHV_ConstantDepth", [("name", f"depth_{number}"), *when, *depth])


def _block(kind: str, settings: list[tuple[str, str]]) -> Iterator[str]:
    yield f"Behavior = {kind}"
    yield "{"
    yield from (f"  {key:<19} = {value}" for key, value in [*settings[:1], ("pwt", "100")])
    yield from (f"  {key:<19} = {value}" for key, value in settings[1:])
    yield "}"


FORMAT = Format(
    name="moos",
    suffix=".bhv",
    reader="MOOS-IvP",
    needs_origin=False,
    has_times=False,
    text=_text,
)
