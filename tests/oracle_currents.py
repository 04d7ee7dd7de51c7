"""The oracle's water: how it moves, and what of that AUVs cannot make good."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from oracle import Cell, Oracle

#: What a speed may exceed the highest one by.
ROUNDING = 1 + 1e-6


class Water:
    """The current over an episode; where the water is still, this does nothing."""

    def __init__(self, oracle: Oracle) -> None:
        self.oracle, self.scenario = oracle, oracle.scenario
        self.settings = oracle.scenario.current
        self.flows = self.settings.kind != "none"
        self.table: dict[tuple[float, ...], tuple[float, float]] | None = None
        spacing = self.scenario.grid.spacing_m
        self.edges_m = tuple(spacing) if isinstance(spacing, tuple) else (spacing,) * 3
        # What chance has added to a current that wanders.
        self.wander = [0.0, 0.0]
        # Of the slot: AUVs that hold their cells against their will, that drift, and that lie at
        # the edge.
        self.holding: set[int] = set()
        self.drifting: set[int] = set()
        self.aground: set[int] = set()

    def begin(self) -> None:
        self.holding, self.drifting, self.aground = set(), set(), set()

    def velocity(self, cell: Cell) -> tuple[float, float]:
        """Along x and y in m/s, in the middle of the slot that comes next."""
        kind, own = self.settings.kind, self.settings
        slot = min(self.oracle.slot, self.scenario.num_slots - 1)
        hours = (slot + 0.5) * self.scenario.slot_s / 3600
        x, y, z = ((c - 1) * edge for c, edge in zip(cell, self.edges_m, strict=True))
        if kind == "vortex":
            x, y = x - own.center_m[0], y - own.center_m[1]
            r = math.hypot(x, y)
            if r == 0:
                return 0.0, 0.0
            core = 1 - math.exp(-((r / own.core_radius_m) ** 2))
            speed, angle = own.circulation_m2_per_s / (2 * math.pi * r) * core, math.atan2(y, x)
            return -speed * math.sin(angle), speed * math.cos(angle)
        if kind == "double_gyre":
            return self.gyre(x, y, hours)
        if kind == "file":
            return self.from_file(x, y, z, hours + own.start_h)
        speed = own.speed_m_per_s
        if kind == "shear":
            top_m = self.scenario.grid.origin.depth_m if self.scenario.grid.origin else 0.0
            speed /= math.exp((top_m + z) / own.depth_scale_m)
        if kind == "tide":
            speed *= math.cos(math.tau * (hours / own.period_h + own.phase_deg / 360))
        angle = math.radians(90 - own.toward_deg)
        along_x, along_y = self.wander
        return speed * math.cos(angle) + along_x, speed * math.sin(angle) + along_y

    def start(self, drawn: Sequence[float]) -> None:
        """Let it begin an episode with what chance adds, by such numbers."""
        sigma = self.settings.sigma_m_per_s
        self.wander = [max(-4 * sigma, min(4 * sigma, sigma * n)) for n in drawn]

    def change(self, drawn: Sequence[float]) -> None:
        """Let it wander on, by a normal number for each component, after a slot."""
        own, lasts_s = self.settings, self.settings.time_constant_h * 3600
        kept = math.exp(-self.scenario.slot_s / lasts_s)
        most = 4 * own.sigma_m_per_s
        new = math.sqrt(1 - kept**2) * own.sigma_m_per_s
        self.wander = [
            max(-most, min(most, kept * old + new * n))
            for old, n in zip(self.wander, drawn, strict=True)
        ]

    def gyre(self, x_m: float, y_m: float, hours: float) -> tuple[float, float]:
        """The slopes of the stream function, by central differences."""
        own, cells = self.settings, self.scenario.grid.cells
        length_m, width_m = cells[0] * self.edges_m[0], cells[1] * self.edges_m[1]
        x_m, y_m = x_m + self.edges_m[0] / 2, y_m + self.edges_m[1] / 2
        shift = own.epsilon * math.sin(math.tau * hours / own.period_h)

        def psi(x_m: float, y_m: float) -> float:
            x, y = 2 * x_m / length_m, y_m / width_m
            f = shift * x**2 + (1 - 2 * shift) * x
            a = own.amplitude_m_per_s * width_m / math.pi
            return a * math.sin(math.pi * f) * math.sin(math.pi * y)

        h = 1e-5 * min(length_m, width_m)
        along_x = -(psi(x_m, y_m + h) - psi(x_m, y_m - h)) / (2 * h)
        return along_x, (psi(x_m + h, y_m) - psi(x_m - h, y_m)) / (2 * h)

    def from_file(self, x: float, y: float, z: float, hours: float) -> tuple[float, float]:
        """Of a CSV file over time_s, depth_m, x_m and y_m, turned from east to the grid's x."""
        origin = self.scenario.grid.origin
        if self.table is None:
            _, *lines = self.settings.file.contents.decode().split("\n")
            self.table = {}
            for line in lines:
                *point, u, v = map(float, line.split(","))
                self.table[tuple(point)] = u, v
        east, north = self.between((3600 * hours, z + origin.depth_m, x, y))
        bearing = math.radians(origin.bearing_deg)
        # The grid's y points to the bearing, its x a quarter of a turn to the right of that.
        along_x = math.sin(bearing + math.pi / 2), math.cos(bearing + math.pi / 2)
        along_y = math.sin(bearing), math.cos(bearing)
        return tuple(east * to_east + north * to_north for to_east, to_north in (along_x, along_y))

    def between(self, point: tuple[float, ...], known: tuple[float, ...] = ()) -> Sequence[float]:
        """Between the points of the table, one axis after the other."""
        axis = len(known)
        if axis == len(point):
            return self.table[known]
        values = sorted({place[axis] for place in self.table})
        above = next(value for value in values if value >= point[axis])
        below = max(value for value in values if value <= point[axis])
        first, second = (self.between(point, (*known, value)) for value in (below, above))
        share = (point[axis] - below) / (above - below) if above > below else 0.0
        return [one + share * (other - one) for one, other in zip(first, second, strict=True)]

    def speed(self, here: Cell, target: Cell, slots: int) -> float:
        """Through the water, to make good a part of the way between two cells in a slot."""
        over_ground = [
            (to - at) * edge / (slots * self.scenario.slot_s)
            for at, to, edge in zip(here, target, self.edges_m, strict=True)
        ]
        flow = (*self.velocity(here), 0.0)
        return math.dist(over_ground, flow)

    def moored(self, here: Cell) -> bool:
        vehicle = self.scenario.vehicle
        return vehicle.kind == "battery" and here in [tuple(dock) for dock in vehicle.docks]

    def can(self, auv: int, here: Cell, target: Cell, slots: int) -> bool:
        """Whether an AUV can make a slot of a way good, by its speed and its energy."""
        vehicles, limit = self.oracle.vehicles, self.scenario.vehicle.max_speed_m_per_s
        if here == target and self.moored(here):
            return True
        speed = self.speed(here, target, slots)
        if limit is not None and speed > limit * ROUNDING:
            return False
        return not vehicles.is_limited or vehicles.battery_j[auv] >= vehicles.speed_j(speed)

    def adrift(self, auv: int, here: Cell) -> list[int]:
        """The direction in which an AUV is carried that cannot make its move good, if any is."""
        if not self.flows or auv in self.oracle.vehicles.stranded:
            return []
        if self.can(auv, here, here, 1):
            self.holding.add(auv)
            return []
        self.drifting.add(auv)
        x, y = self.velocity(here)
        direction = (0 if x >= 0 else 1) if abs(x) >= abs(y) else (2 if y >= 0 else 3)
        if not self.oracle.ahead(here, direction)[1]:
            self.aground.add(auv)
        return [direction]
