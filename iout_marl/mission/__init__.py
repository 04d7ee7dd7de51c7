"""An episode as a plan for vehicles: where each AUV goes and when, and what it does there."""

from iout_marl.core.geography import Place
from iout_marl.mission.formats import FORMATS, Format, format_named
from iout_marl.mission.mission import Action, Mission, plan_mission
from iout_marl.mission.route import Route, Waypoint
from iout_marl.mission.writing import mission_files, write_mission

__all__ = [
    "FORMATS",
    "Action",
    "Format",
    "Mission",
    "Place",
    "Route",
    "Waypoint",
    "format_named",
    "mission_files",
    "plan_mission",
    "write_mission",
]
