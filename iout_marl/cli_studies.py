"""The commands that run studies and write reports."""

from __future__ import annotations

import os
import shlex
import signal
from pathlib import Path
from types import FrameType
from typing import Annotated

import typer

from iout_marl import machine
from iout_marl.errors import InputError
from iout_marl.files import write_atomically

ScenarioArgument = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="A bundled name, or a path to a YAML file.")
]
JsonFile = Annotated[
    Path | None,
    typer.Option("--json", metavar="FILE", help="Also write the figures as JSON; - prints it."),
]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="Change a key of the scenario; may be repeated."
    ),
]


def reproduce(
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder of the study [runs/STUDY or runs/STUDY-quick]."),
    ] = None,
    *,
    quick: Annotated[
        bool, typer.Option("--quick", help="The study's short form: minutes, one seed.")
    ] = False,
    study: Annotated[
        str, typer.Option(metavar="STUDY", help="A bundled study, or a path to a YAML file.")
    ] = "paper",
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Processes side by side [the number of cores].")
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Run on the Dask cluster of this scheduler."),
    ] = None,
    overrides: Overrides = None,
) -> None:
    """Run a study, by default the paper's, and write its report.

    What is finished stays: the same command goes on with a study that was stopped.
    """
    from iout_marl.study.cells import expand
    from iout_marl.study.pools import DaskCluster, LocalProcesses
    from iout_marl.study.run import StudyFolder, run_study
    from iout_marl.study.schema import load_study

    if jobs is not None and scheduler is not None:
        raise InputError("--jobs and --scheduler: a cluster has its own number of workers")
    loaded, layer = load_study(study)
    cells = expand(loaded, layer, overrides or [], quick=quick)
    name = Path(study).stem
    folder = StudyFolder(out or Path("runs") / (f"{name}-quick" if quick else name))
    words = ["iout", "reproduce", *(["--study", study] if study != "paper" else [])]
    words += ["--quick"] if quick else []
    words += [word for setting in overrides or [] for word in ("--set", setting)]
    pool = DaskCluster(scheduler) if scheduler else LocalProcesses(jobs or machine.num_cores())
    identity = {
        "name": name,
        "title": loaded.title,
        "overrides": list(overrides or []),
        "quick": quick,
    }
    before = signal.signal(signal.SIGTERM, _interrupt)
    try:
        with folder.open(identity):
            results = run_study(
                name, loaded, cells, folder, pool, command=shlex.join(words), quick=quick
            )
    except KeyboardInterrupt:
        where = ["--scheduler", scheduler] if scheduler else ["--jobs", str(jobs)] if jobs else []
        again = shlex.join([*words, *where, "--out", str(folder.path)])
        typer.echo(f"\nstopped; what is finished stays. Go on with: {again}", err=True)
        raise typer.Exit(130) from None
    finally:
        signal.signal(signal.SIGTERM, before)
    _write(folder.path)
    if results.failures:
        for failure in results.failures:
            place = f"{failure.series}, {loaded.axis.key} {failure.axis:g}, seed {failure.seed}"
            typer.echo(f"failed: {place}: {failure.error}", err=True)
        typer.echo(f"{len(results.failures)} of {len(cells)} cells failed", err=True)
        raise typer.Exit(1)


def report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder with a results.json.")],
    markdown: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Where the Markdown goes [DIR/report.md]."),
    ] = None,
) -> None:
    """Write the report of a study's results once more: page, Markdown and figures."""
    _write(folder, markdown)


def _write(folder: Path, markdown: Path | None = None) -> None:
    from iout_marl.report.build import build_report
    from iout_marl.report.markdown import render_markdown
    from iout_marl.report.markup import plain_text
    from iout_marl.report.writer import write_report
    from iout_marl.study.results import read_results

    built = build_report(read_results(folder / "results.json"))
    write_report(built, folder)
    text = markdown or folder / "report.md"
    figures = Path(os.path.relpath(folder / "figures", text.parent)).as_posix()
    write_atomically(text, render_markdown(built, figures).encode())
    for line in built.lead:
        typer.echo(plain_text(line))
    typer.echo(f"The report is {folder / 'report.html'}")


def _interrupt(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
    raise KeyboardInterrupt
