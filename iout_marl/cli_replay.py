"""The command that shows an episode: as a page for a browser, or as a film."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from iout_marl.cli_options import (
    POLICY,
    Imports,
    Overrides,
    expanded,
    file_ending,
    refuse_same_file,
    take,
    whole,
)
from iout_marl.cli_policies import keep_inputs, record_named
from iout_marl.errors import InputError
from iout_marl.extras import require
from iout_marl.files import write_text
from iout_marl.render.film import write_film
from iout_marl.replay import Recording
from iout_marl.replay.film import frames
from iout_marl.replay.page import MOST_EPISODES, check_together, is_replay_page, render_page
from iout_marl.scenario import Scenario, load_scenario
from iout_marl.scenario.loading import parse_scenario
from iout_marl.terminal import present
from iout_marl.whole import MAX_SEED
from iout_marl.words import counted, listed
from iout_marl.world import draws_layout_once

#: Where the page is written if nothing is said.
_PAGE = Path("replay.html")
_FPS = 5


def replay(
    scenario: Annotated[
        str | None,
        typer.Argument(
            metavar="SCENARIO",
            parser=expanded,
            help="What --policy plays: a bundled name, or a path to a YAML file; of a family, "
            "FILE.yaml/MEMBER. A --recording brings its own.",
        ),
    ] = None,
    policy: Annotated[
        list[str] | None,
        typer.Option(
            metavar=POLICY,
            parser=expanded,
            help="Who plays; a second one is shown beside it, on the same clock.",
        ),
    ] = None,
    recording: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FILE",
            parser=expanded,
            help="An episode that was kept, by iout evaluate --save-episode or iout_marl.record, "
            "in place of a policy or beside it.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            parser=file_ending(".html"),
            help=f"The page [{_PAGE}, unless there is a film].",
        ),
    ] = None,
    gif: Annotated[
        Path | None,
        typer.Option(metavar="FILE", parser=file_ending(".gif"), help="A film as an animated GIF."),
    ] = None,
    mp4: Annotated[
        Path | None,
        typer.Option(metavar="FILE", parser=file_ending(".mp4"), help="A film as an MP4."),
    ] = None,
    fps: Annotated[
        int | None,
        typer.Option(metavar="N", parser=whole(1, 50), help=f"Slots a second of a film [{_FPS}]."),
    ] = None,
    seed: Annotated[
        int,
        typer.Option(
            metavar="N", parser=whole(0, MAX_SEED), help="Seed of the layout and of chance."
        ),
    ] = 0,
    *,
    sampled: Annotated[
        bool,
        typer.Option(
            "--sampled",
            help="Draw the actions of trained policies, rather than take the most probable.",
        ),
    ] = False,
    transfer: Annotated[
        bool, typer.Option("--transfer", help="Allow runs of another scenario that fits.")
    ] = False,
    overrides: Overrides = None,
    imports: Imports = None,
) -> None:
    """Show an episode: as one page that plays it offline, and as a film."""
    take(imports)
    names, kept = policy or [], recording or []
    if not 1 <= len(names) + len(kept) <= MOST_EPISODES:
        given = counted(len(names) + len(kept), "one", "of them") if names or kept else "none"
        raise InputError(f"name one or two of --policy and --recording, not {given}")
    if names and scenario is None:
        raise InputError("--policy: needs a SCENARIO to play in")
    if fps is not None and not (gif or mp4):
        raise InputError("--fps: is of a film, by --gif or --mp4")
    if gif or mp4:
        require("--gif" if gif else "--mp4", "film", "imageio_ffmpeg", "matplotlib")
    loaded = None if scenario is None else load_scenario(scenario, overrides or [])
    recordings = [_read(path, loaded) for path in kept]
    page = out or (None if gif or mp4 else _PAGE)
    if out is None and page is not None and os.path.lexists(page) and not is_replay_page(page):
        raise InputError(f"{page}: is there already, and is no replay: name another file by --out")
    refuse_same_file({"--out": page, "--gif": gif, "--mp4": mp4})
    for target in (page, gif, mp4):
        keep_inputs(target, names)
    if loaded is not None and names:
        played = record_named(loaded, names, seed, transfer=transfer, sampled=sampled)
        recordings = [*played, *recordings]
    check_together(recordings)
    who = listed([each.policy for each in recordings])
    slots = counted(max(each.slots for each in recordings), "slot")
    if page is not None:
        write_text(page, render_page(recordings))
        _say(page, f"{slots} of {who}")
    for film in filter(None, (gif, mp4)):
        write_film(film, frames(recordings), fps or _FPS)
        _say(film, f"{slots} of {who}, {fps or _FPS} a second")


def _read(path: str, scenario: Scenario | None) -> Recording:
    """A recording; of the scenario, if there is one."""
    found = Recording.load(path)
    if scenario is None or found.scenario_hash == scenario.hash:
        return found
    if draws_layout_once(scenario) and _differs_in_layout(found, scenario, path):
        return found
    raise InputError(
        f"--recording {path}: is of {found.scenario} ({found.scenario_hash}), not of "
        f"{scenario.name} ({scenario.hash})"
    )


def _differs_in_layout(recording: Recording, scenario: Scenario, path: str) -> bool:
    """Whether a recording is of the scenario but for its nodes, whose layout is in the hash."""
    try:
        own = parse_scenario(Path(path), recording.scenario_yaml.encode())
    except InputError as error:
        raise InputError(f"--recording {path}: scenario_yaml: {error}") from None
    if own.num_nodes != scenario.num_nodes:
        return False
    return own.model_copy(update={"nodes": scenario.nodes}).hash == scenario.hash


def _say(path: Path, what: str) -> None:
    present(f"{path}: {what}, {os.path.getsize(path) / 1e6:.1f} MB")  # noqa: PTH202
