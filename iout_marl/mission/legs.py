"""Legs for formats that know no times: where a vehicle is follows from speeds and stays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iout_marl.core.geography import Floats, Place, distances_m
from iout_marl.errors import InputError
from iout_marl.mission.route import Route

#: The most by which an arrival, computed from what is written, may miss its time.
MAX_ERROR_S = 1.0
#: Digits of what is written: degrees to 0.1 mm, m to 1 mm, m/s so that a day's way is exact to
#: centimetres.
DEGREE_DIGITS, METRE_DIGITS, SPEED_DIGITS = 9, 3, 6
#: Of seconds, here and wherever else a mission has them.
SECOND_DIGITS = 3


@dataclass(frozen=True)
class Leg:
    """A straight run to a waypoint, and a stay there.

    Attributes:
        point: the waypoint, as written: latitude and longitude in degrees, or metres to the east
            and north; and depth in m.
        horizontal_m_per_s, down_m_per_s: speed; negative where the vehicle rises. 0 and 0 at the
            start.
        run_s: how long the run takes at these speeds.
        hold_s: how long the vehicle stays.
        arrival_s: since the start.
    """

    point: tuple[float, float, float]
    horizontal_m_per_s: float
    down_m_per_s: float
    run_s: float
    hold_s: float
    arrival_s: float

    @property
    def speed_m_per_s(self) -> float:
        """Along the run."""
        return round(float(np.hypot(self.horizontal_m_per_s, self.down_m_per_s)), SPEED_DIGITS)


def geodetic_legs(route: Route, place: Place) -> list[Leg]:
    """Legs by latitude and longitude, with stays of whole seconds.

    Raises:
        InputError: an arrival would miss its time.
    """
    points = place.geodetic(route.local)
    points[:, :2] = points[:, :2].round(DEGREE_DIGITS)
    points[:, 2] = points[:, 2].round(METRE_DIGITS)
    return _legs(route, points, distances_m(points), hold_digits=0)


def local_legs(route: Route, place: Place) -> list[Leg]:
    """Legs by metres to the east and north.

    Raises:
        InputError: as for `geodetic_legs`.
    """
    points = place.east_north(route.local).round(METRE_DIGITS)
    distances = np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1)
    return _legs(route, points, distances, hold_digits=SECOND_DIGITS)


def _legs(route: Route, points: Floats, distances: Floats, *, hold_digits: int) -> list[Leg]:
    """Legs of points as they are written, whose arrivals are checked.

    Args:
        route: what is written.
        points: (waypoints, 3).
        distances: (waypoints − 1,) in m, horizontally between the points.
        hold_digits: of the stays, in s. What a stay is rounded by, the next one makes up for.
    """
    steps = np.diff(route.local, axis=0)
    arrival_s, departure_s = 0.0, 0.0
    legs = []
    for i, waypoint in enumerate(route.waypoints):
        horizontal = down = run_s = 0.0
        if i:
            due_s = waypoint.arrival_s - route.waypoints[i - 1].departure_s
            across_m = float(np.hypot(*steps[i - 1, :2]))
            horizontal = round(across_m / due_s, SPEED_DIGITS)
            down = round(float(steps[i - 1, 2]) / due_s, SPEED_DIGITS)
            deeper_m = float(points[i, 2] - points[i - 1, 2])
            run_s = max(_seconds(float(distances[i - 1]), horizontal), _seconds(deeper_m, down))
            arrival_s = departure_s + run_s
        late_s = arrival_s - waypoint.arrival_s
        if not abs(late_s) <= MAX_ERROR_S:
            how = "late" if late_s > 0 else "early"
            raise InputError(
                f"AUV {route.auv}: would be {abs(late_s):.1f} s too {how} at waypoint {i + 1}: the "
                "grid is too large, or its cells are too small, for a plan without times"
            )
        hold_s = 0.0
        if waypoint.hold_s:
            hold_s = max(0.0, round(waypoint.departure_s - arrival_s, hold_digits))
        departure_s = arrival_s + hold_s
        first, second, depth_m = points[i].tolist()
        legs.append(Leg((first, second, depth_m), horizontal, down, run_s, hold_s, arrival_s))
    return legs


def _seconds(distance_m: float, speed: float) -> float:
    """How long a distance takes; none where there is no speed in its direction."""
    return distance_m / speed if speed else 0.0
