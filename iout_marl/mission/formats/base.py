"""What a format of mission files is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from iout_marl.errors import printable
from iout_marl.mission.mission import Mission
from iout_marl.mission.route import Route


@dataclass(frozen=True)
class Format:
    """A format of mission files, of which each AUV gets one.

    Attributes:
        name: on the command line.
        suffix: of its files.
        reader: what reads it.
        needs_origin: it places things on Earth.
        has_times: it says when; otherwise arrival follows from speed.
        text: what stands in the file of an AUV.
    """

    name: str
    suffix: str
    reader: str
    needs_origin: bool
    has_times: bool
    text: Callable[[Mission, Route], str]


def title(mission: Mission, route: Route) -> str:
    """What a file calls the way of an AUV, in one line."""
    seed = "" if mission.seed is None else f", seed {mission.seed}"
    what = f"{mission.scenario} ({mission.scenario_hash}), {mission.policy}{seed}"
    return printable(f"AUV {route.auv} of {what}")
