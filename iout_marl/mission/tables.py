"""Comma-separated tables of missions, and the actions as a table and as JSON."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from iout_marl.core.geography import Floats, Place
from iout_marl.files import to_json
from iout_marl.mission.legs import DEGREE_DIGITS, METRE_DIGITS, SECOND_DIGITS
from iout_marl.mission.mission import Mission


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """A CSV file of one row or more, without a line break at its end; None is an empty cell."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(rows[0])
    for row in rows:
        writer.writerow([str(v).lower() if isinstance(v, bool) else v for v in row.values()])
    return stream.getvalue().rstrip("\n")


def located(place: Place, local: Floats) -> Iterable[dict[str, float | None]]:
    """Of each of (points, 3) local metres the columns that say where it is.

    Latitude and longitude are None where the grid has no origin.
    """
    degrees = np.full((len(local), 2), np.nan)
    if place.origin is not None:
        degrees = place.geodetic(local)[:, :2]
    for (x, y, depth), (latitude, longitude) in zip(
        local.round(METRE_DIGITS).tolist(), degrees.round(DEGREE_DIGITS).tolist(), strict=True
    ):
        yield {
            "x_m": x,
            "y_m": y,
            "depth_m": depth,
            "latitude_deg": None if np.isnan(latitude) else latitude,
            "longitude_deg": None if np.isnan(longitude) else longitude,
        }


def actions_csv(mission: Mission) -> str:
    """All actions, one in each line."""
    return table(_actions(mission))


def actions_json(mission: Mission) -> str:
    """The mission's origin, its nodes, and all actions."""
    origin = mission.place.origin
    nodes = located(mission.place, mission.place.local(mission.node_cells))
    return to_json(
        {
            "scenario": mission.scenario,
            "scenario_hash": mission.scenario_hash,
            "policy": mission.policy,
            "seed": mission.seed,
            "start_utc": mission.at(0),
            "slot_s": mission.slot_s,
            "origin": None if origin is None else origin.model_dump(),
            "auvs": len(mission.routes),
            "nodes": [{"node": i, **where} for i, where in enumerate(nodes, start=1)],
            "actions": _actions(mission),
        },
        indent=2,
    )


def _actions(mission: Mission) -> list[dict[str, Any]]:
    local = mission.place.local([action.position for action in mission.actions])
    return [
        {
            "auv": action.auv,
            "slot": action.slot,
            "action": action.kind,
            "node": action.node,
            "start_s": round(action.start_s, SECOND_DIGITS),
            "end_s": round(action.end_s, SECOND_DIGITS),
            "start_utc": mission.at(action.start_s),
            "end_utc": mission.at(action.end_s),
            "energy_j": float(f"{action.energy_j:.6g}"),
            "delivered": action.delivered,
            **where,
        }
        for action, where in zip(mission.actions, located(mission.place, local), strict=True)
    ]
