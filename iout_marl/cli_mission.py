"""The command that makes a plan for vehicles of an episode."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from iout_marl.cli_options import (
    POLICY,
    Imports,
    Overrides,
    ScenarioArgument,
    expanded,
    folder,
    take,
    whole,
)
from iout_marl.cli_policies import player_named
from iout_marl.errors import InputError
from iout_marl.mission import FORMATS, Format, format_named, plan_mission, write_mission
from iout_marl.mission.writing import check_formats, check_new, file_names
from iout_marl.policies.loading import is_run
from iout_marl.scenario import load_scenario
from iout_marl.terminal import present
from iout_marl.whole import MAX_SEED
from iout_marl.words import counted


def _utc(text: str) -> datetime:
    """Reads a moment: 2027-05-01T08:00:00Z; without a zone it is UTC."""
    try:
        moment = datetime.fromisoformat(text)
        return moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment.astimezone(UTC)
    except (ValueError, OverflowError):
        raise typer.BadParameter(
            f"must be a time in UTC such as 2027-05-01T08:00:00Z, not {text!r}"
        ) from None


def _format(text: str) -> Format:
    """Reads the name of a format."""
    try:
        return format_named(text)
    except InputError as error:
        raise typer.BadParameter(str(error)) from None


def mission(
    scenario: ScenarioArgument,
    policy: Annotated[
        str,
        typer.Option(metavar=POLICY, parser=expanded, help="Who plays, as for iout evaluate."),
    ],
    formats: Annotated[
        list[Format],
        typer.Option(
            "--format",
            metavar="FORMAT",
            parser=_format,
            help=f"{', '.join(FORMATS)}. May be repeated.",
        ),
    ],
    out: Annotated[
        Path, typer.Option(metavar="DIR", parser=folder, help="Folder of the files, which are new.")
    ],
    seed: Annotated[
        int, typer.Option(metavar="N", parser=whole(0, MAX_SEED), help="Seed of the episode.")
    ] = 0,
    start_time: Annotated[
        datetime | None,
        typer.Option(metavar="TIME", parser=_utc, help="When it begins, ISO 8601 in UTC [now]."),
    ] = None,
    *,
    sampled: Annotated[
        bool, typer.Option("--sampled", help="Draw the actions of a trained policy.")
    ] = False,
    transfer: Annotated[
        bool, typer.Option("--transfer", help="Allow a run of another scenario that fits.")
    ] = False,
    overrides: Overrides = None,
    imports: Imports = None,
) -> None:
    """Write an episode as a plan for vehicles: a file for each AUV, and what to do when."""
    take(imports)
    loaded = load_scenario(scenario, overrides or [])
    wanted = list(dict.fromkeys(formats))
    check_formats(loaded, wanted)
    check_new(out, file_names(loaded.num_auvs, wanted))
    if sampled and not is_run(policy):
        raise InputError("--sampled: the policy is no trained one, by the folder of a run")
    own, player = player_named(loaded, policy, seed, "--policy", transfer=transfer, sampled=sampled)
    planned = plan_mission(own, player, seed, start_time)
    written = write_mission(planned, wanted, out)
    end_s = max(route.end_s for route in planned.routes)
    present(
        f"{out}: {counted(len(written), 'file')} written: {counted(loaded.num_auvs, 'AUV')}, "
        f"{planned.at(0)} to {planned.at(end_s)}"
    )
    stays_s = [stop.hold_s for route in planned.routes for stop in route.waypoints if stop.hold_s]
    if any(each.name == "imc" for each in wanted) and stays_s:
        present(
            f"note: imc has {counted(len(stays_s), 'stay')}, of {max(stays_s):,.0f} s at most, for "
            "which a vehicle may come to the surface"
        )
    for route in planned.routes:
        present(f"AUV {route.auv}: {counted(len(route.waypoints), 'waypoint')}")
