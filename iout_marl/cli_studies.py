"""The commands that run studies and write reports."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from iout_marl import machine
from iout_marl.cli_options import Imports, Overrides, expanded, file_ending, folder, take, whole
from iout_marl.errors import InputError
from iout_marl.extras import how_to_install, missing, require
from iout_marl.files import path_from, write_text
from iout_marl.outside import import_words
from iout_marl.policies import load_policy
from iout_marl.signals import Stopped, StopSignals
from iout_marl.terminal import complain, imports_uninterrupted, present

#: More than that only slow one another, and fill the memory.
PROCESSES_PER_CORE = 8


def reproduce(
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            parser=folder,
            help="Folder of the study [runs/STUDY or runs/STUDY-quick].",
        ),
    ] = None,
    *,
    quick: Annotated[
        bool, typer.Option("--quick", help="The study's short form: minutes, one seed.")
    ] = False,
    study: Annotated[
        str,
        typer.Option(
            metavar="STUDY", parser=expanded, help="A bundled study, or a path to a YAML file."
        ),
    ] = "paper",
    jobs: Annotated[
        int | None,
        typer.Option(
            metavar="N", parser=whole(1, 1000), help="Processes side by side [the number of cores]."
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Run on the Dask cluster of this scheduler."),
    ] = None,
    policy: Annotated[
        list[str] | None,
        typer.Option(
            metavar="MODULE:NAME",
            parser=expanded,
            help="A policy of your own, by MODULE:NAME or FILE.py:NAME, that the study lists among "
            "its policies; no study makes code run that is not named here. May be repeated.",
        ),
    ] = None,
    overrides: Overrides = None,
    imports: Imports = None,
) -> None:
    """Run a study, by default the paper's, and write its report.

    What is finished stays: the same command continues with a study that was stopped.
    """
    require("iout reproduce", "report")
    with imports_uninterrupted():
        from iout_marl.study.cells import expand
        from iout_marl.study.cluster import DaskCluster, LostClusterError
        from iout_marl.study.fields import show
        from iout_marl.study.pools import LocalProcesses
        from iout_marl.study.run import StudyFolder, run_study
        from iout_marl.study.schema import load_study

    if jobs is not None and scheduler is not None:
        raise InputError("--jobs and --scheduler: a cluster has its own number of workers")
    if jobs is not None and jobs > (most := PROCESSES_PER_CORE * machine.num_cores()):
        raise InputError(
            f"--jobs {jobs}: must be at most {most}: {PROCESSES_PER_CORE} processes for each of "
            f"the {machine.num_cores()} cores"
        )
    take(imports)
    loaded, layer = load_study(study)
    outside = list(policy or [])
    cells = expand(loaded, layer, overrides or [], outside, quick=quick)
    for name in outside:
        try:
            load_policy(name)  # what is wrong with it shows before the first cell is run
        except InputError as error:
            raise InputError(f"--{error}") from None
    name = Path(study).stem
    usual = Path("runs") / (f"{name}-quick" if quick else name)
    folder = StudyFolder(out or usual)
    words = ["iout", "reproduce", *(["--study", study] if study != "paper" else [])]
    words += ["--quick"] if quick else []
    words += import_words()
    words += [word for name in outside for word in ("--policy", name)]
    words += [word for setting in overrides or [] for word in ("--set", setting)]
    where = [] if scheduler is None else ["--scheduler", scheduler]
    where += [] if jobs is None else ["--jobs", str(jobs)]
    go_on = f"Continue with: {shlex.join([*words, *where, '--out', str(folder.path)])}"
    identity = {
        "name": show(name),
        "title": loaded.title,
        "overrides": list(overrides or []),
        "quick": quick,
    }
    if scheduler is None and missing("emissions") and any(cell.trains for cell in cells):
        complain(f"note: no energy of trainings is measured: {how_to_install('emissions')}")
    try:
        with StopSignals(at_once=True) as stop:
            pool = (
                LocalProcesses(jobs or machine.num_cores())
                if scheduler is None
                else DaskCluster(scheduler)
            )
            with folder.open(identity):
                results = run_study(
                    *(show(name), loaded, cells, folder, pool),
                    command=show(shlex.join(words)),
                    quick=quick,
                )
            lines = _written(folder.path, kept=True)
    except Stopped:
        complain(f"\nstopped; what is finished stays. {go_on}")
        raise typer.Exit(128 + (stop.number or 0)) from None
    except LostClusterError as error:
        raise InputError(f"{error}; what is finished stays. {go_on}") from None
    present("\n".join(lines))
    if results.failures:
        for failure in results.failures:
            place = f"{loaded.axis.name} {loaded.axis.text(failure.axis)}, seed {failure.seed}"
            complain(f"failed: {failure.series}, {place}: {failure.error}")
        complain(f"{len(results.failures)} of {len(cells)} cells failed")
        raise typer.Exit(1)


def report(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", parser=folder, help="Folder with a results.json.")
    ],
    markdown: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            parser=file_ending(".md"),
            help="Where the Markdown goes [DIR/report.md].",
        ),
    ] = None,
    imports: Imports = None,
) -> None:
    """Write the report of a study's results once more: page, Markdown and figures."""
    require("iout report", "report")
    if not folder.is_dir():
        what = "is a file, not a folder" if folder.exists() else "no such folder"
        raise InputError(f"{folder}: {what}")
    if markdown is not None and _is_of_a_study(folder, markdown):
        raise InputError(f"{markdown}: cannot be written: it is a file of the study in {folder}")
    if not (folder / "results.json").exists():
        raise InputError(f"{folder}: holds no results.json{_why_no_results(folder)}")
    take(imports)
    present("\n".join(_written(folder, markdown)))


def _is_of_a_study(folder: Path, target: Path) -> bool:
    """Whether a file is one that a study keeps, or that its report has beside the Markdown."""
    from iout_marl.study.run import OWN

    place, top = target.resolve(), folder.resolve()
    return place.is_relative_to(top) and place.relative_to(top).parts[0] in OWN


def _why_no_results(folder: Path) -> str:
    if (folder / "study.json").exists():
        return ": its study is not finished; iout reproduce, as it was begun, continues with it"
    others = sorted(path.parent for path in folder.glob("*/results.json"))
    if others:
        return f"; did you mean {shlex.quote(str(others[0]))}?"
    return "; iout reproduce --out DIR makes one"


def _written(folder: Path, markdown: Path | None = None, *, kept: bool = False) -> list[str]:
    """Write the report of a folder's results; what to show of it.

    Args:
        folder: of the results.
        markdown: where the Markdown goes.
        kept: say where the results are, should it fail: they have just been computed.
    """
    from iout_marl.report.build import build_report
    from iout_marl.report.markdown import render_markdown
    from iout_marl.report.markup import plain_text
    from iout_marl.report.writer import write_report
    from iout_marl.study.results import read_results

    text = markdown or folder / "report.md"
    if text.is_dir():
        raise InputError(f"{text}: cannot be written: is a folder, not a file")
    results = read_results(folder / "results.json")
    try:
        built = build_report(results)
        write_report(built, folder)
        figures = Path(path_from(folder / "figures", text.parent)).as_posix()
        rendered = render_markdown(built, figures)
        write_text(text, rendered.rstrip("\n"))
    except InputError as error:
        once_more = shlex.join(["iout", "report", str(folder), *import_words()])
        hint = f"; the results are kept, write their report with: {once_more}" if kept else ""
        raise InputError(f"{error}{hint}") from None
    return [*map(plain_text, built.lead), f"The report is {folder / 'report.html'}"]
