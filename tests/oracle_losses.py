"""Tables of transmission loss a second time, read from lists line by line, for the oracle."""

from __future__ import annotations

import csv
import io
import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from iout_marl.scenario import Scenario

    Cell = tuple[int, int, int]


class Losses:
    """Losses in dB between cells, by what CSV files list."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.transmission = scenario.channel.transmission
        self.known: dict[tuple[Cell, Cell, float], float] = {}
        self.lines: list[dict[str, float]] = []
        for file in self.transmission.tables:
            rows = csv.DictReader(io.StringIO(file.contents.decode()))
            self.lines += [{key: float(value) for key, value in row.items()} for row in rows]

    @classmethod
    def from_scenario(cls, scenario: Scenario) -> Losses | None:
        """Those of a scenario; None where there is a formula instead."""
        transmission = getattr(scenario.channel, "transmission", None)
        return None if transmission is None or transmission.kind == "formula" else cls(scenario)

    def between_db(self, auv: Cell, node: Cell, khz: float) -> float:
        key = auv, node, khz
        if key not in self.known:
            self.known[key] = self.look_up(auv, node, khz)
        return self.known[key]

    def look_up(self, auv: Cell, node: Cell, khz: float) -> float:
        lines = [line for line in self.lines if math.isclose(line["frequency_khz"], khz)]
        if self.transmission.kind == "cells":
            names = ("auv_x", "auv_y", "auv_z", "node_x", "node_y", "node_z")
            (line,) = [a for a in lines if [a[name] for name in names] == [*auv, *node]]
            return line["loss_db"]
        spacing = self.scenario.grid.spacing_m
        edge_x, edge_y, edge_z = spacing if isinstance(spacing, tuple) else (spacing,) * 3
        range_m = math.hypot((auv[0] - node[0]) * edge_x, (auv[1] - node[1]) * edge_y)
        top_m = self.transmission.top_depth_m
        if top_m is None:
            top_m = self.scenario.grid.origin.depth_m
        sought = {
            "range_m": max(range_m, min(line["range_m"] for line in lines)),
            "auv_depth_m": top_m + (auv[2] - 1) * edge_z,
            "node_depth_m": top_m + (node[2] - 1) * edge_z,
        }
        return interpolated(lines, sought)


def interpolated(lines: list[dict[str, float]], sought: dict[str, float]) -> float:
    """Along one axis after the other."""
    if not sought:
        (line,) = lines
        return line["loss_db"]
    (name, value), *others = sought.items()
    known = sorted({line[name] for line in lines})
    low = max((k for k in known if k <= value + 1e-9), default=known[0])
    high = min((k for k in known if k >= value - 1e-9), default=known[-1])
    at_low, at_high = (
        interpolated([line for line in lines if line[name] == at], dict(others))
        for at in (low, high)
    )
    if low == high:
        return at_low
    scale = math.log if name == "range_m" else float
    share = (scale(value) - scale(low)) / (scale(high) - scale(low))
    return at_low + share * (at_high - at_low)
