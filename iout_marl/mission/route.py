"""The way of an AUV: straight runs between waypoints, and how long it stays at each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from iout_marl.core.geography import Place

_STEP_DIGITS = 9


@dataclass(frozen=True)
class Waypoint:
    """A place where an AUV turns, stays, begins or ends.

    Attributes:
        local: (x, y, depth) in m, see `Place`.
        arrival_s: since the mission began.
        hold_s: how long the AUV stays.
        speed_m_per_s: of the straight run that leads here; 0 at the start.
    """

    local: tuple[float, float, float]
    arrival_s: float
    hold_s: float
    speed_m_per_s: float

    @property
    def departure_s(self) -> float:
        """When the AUV leaves again."""
        return self.arrival_s + self.hold_s


@dataclass(frozen=True)
class Route:
    """The way of one AUV.

    Attributes:
        auv: its number, from 1.
        waypoints: the start first.
    """

    auv: int
    waypoints: tuple[Waypoint, ...]

    @classmethod
    def from_path(
        cls,
        auv: int,
        positions: npt.NDArray[np.float64],
        place: Place,
        slot_s: float,
    ) -> Route:
        """The way through (slots + 1, 3) positions before and after each slot, in cells.

        Successive slots with the same step are one straight run, those without a step one stay.
        """
        # Thirds of a cell are equally long but for roundings.
        steps, local = np.diff(positions, axis=0).round(_STEP_DIGITS), place.local(positions)
        turns = np.flatnonzero((steps[1:] != steps[:-1]).any(axis=1)) + 1
        bounds = [0, *turns.tolist(), len(steps)]
        waypoints = [Waypoint(_triple(local[0]), 0.0, 0.0, 0.0)]
        for first, end in pairwise(bounds):
            duration_s = (end - first) * slot_s
            if not steps[first].any():
                waypoints[-1] = replace(waypoints[-1], hold_s=duration_s)
                continue
            distance_m = float(np.linalg.norm(local[end] - local[first]))
            speed = distance_m / duration_s
            waypoints.append(Waypoint(_triple(local[end]), end * slot_s, 0.0, speed))
        return cls(auv, tuple(waypoints))

    @property
    def local(self) -> npt.NDArray[np.float64]:
        """(waypoints, 3) of all waypoints, in m."""
        return np.array([waypoint.local for waypoint in self.waypoints])

    @property
    def end_s(self) -> float:
        """When the mission is over."""
        return self.waypoints[-1].departure_s

    def moments(self) -> Iterator[tuple[float, int]]:
        """Seconds, and the number from 0 of the waypoint where the AUV is then.

        Both ends of each stay; between two moments the AUV goes straight at an even speed.
        """
        for i, waypoint in enumerate(self.waypoints):
            yield waypoint.arrival_s, i
            if waypoint.hold_s:
                yield waypoint.departure_s, i


def _triple(values: npt.NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, depth = values.tolist()
    return x, y, depth
