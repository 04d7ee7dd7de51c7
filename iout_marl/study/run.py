"""Runs a study in a folder: what is finished stays, what is missing is run.

| file | holds |
|---|---|
| `study.json` | which study it is, and the versions that it is of |
| `cells/KEY.json` | the record of a finished cell |
| `runs/KEY/` | the run folder of a cell that trained; a bound's certificate |
| `results.json`, `results.csv` | all cells together |
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from iout_marl.errors import InputError
from iout_marl.files import LOCK_NAME, locked, read_json, to_json, write_atomically
from iout_marl.study.cells import Cell
from iout_marl.study.fields import LONGEST, Line, Words, show
from iout_marl.study.pools import Outcomes, Pool
from iout_marl.study.records import Saved
from iout_marl.study.results import (
    FORMAT,
    CellResult,
    Failure,
    Record,
    Results,
    check_version,
    read_record,
    read_results,
    record_to_json,
    validated,
)
from iout_marl.study.schema import Study
from iout_marl.study.worker import Output
from iout_marl.terminal import progress_console
from iout_marl.world import WORLD_VERSION

#: The file that says which study a folder holds.
MARKER = "study.json"
#: What a start that was killed may leave before that file is there.
BEGUN = (LOCK_NAME, "cells", "runs", f"{MARKER}.part")
#: What it holds once it is finished, all but the report's Markdown, which may be elsewhere.
OWN = (LOCK_NAME, MARKER, "cells", "runs", "results.json", "results.csv", "report.html", "figures")
#: Files of a run that no policy needs.
LOGS = ("metrics.jsonl", "events.out.tfevents.")
#: What a kill leaves of files that were being written.
PARTS = (
    *("study.json.part", "results.*.part", "report.*.part"),
    *("cells/*.part", "runs/*/*.part", "figures/*.part"),
)


class Identity(Saved):
    """What tells a study from others; the file that marks its folder has it."""

    name: Line
    title: Words
    overrides: list[str]
    quick: bool


@dataclass(frozen=True)
class StudyFolder:
    """The folder of a study."""

    path: Path

    @property
    def results_path(self) -> Path:
        """All results."""
        return self.path / "results.json"

    @contextmanager
    def open(self, identity: Mapping[str, Any]) -> Iterator[None]:
        """Make the folder, or continue in it; nobody else can while this one does.

        Args:
            identity: what tells the study from others: name, title, overrides, short form.

        Raises:
            InputError: it holds something else, results of another version or of another
                study, cannot be written, or is in use. Nothing in it is changed then.
        """
        wanted = Identity.model_validate(identity)
        self._check(wanted)
        if self.results_path.exists():
            with self._another_is_free():
                read_results(self.results_path)
        with self._writable():
            self.path.mkdir(parents=True, exist_ok=True)
        with locked(self.path, "another study is running in it"):
            self._check(wanted)  # again: until now another one may have begun
            with self._writable():
                for pattern in PARTS:
                    for part in self.path.glob(pattern):
                        part.unlink()
                (self.path / "cells").mkdir(exist_ok=True)
                (self.path / "runs").mkdir(exist_ok=True)
            data = {"format": FORMAT, "world_version": WORLD_VERSION, **wanted.model_dump()}
            write_atomically(self.path / MARKER, (to_json(data, indent=2) + "\n").encode())
            yield

    @contextmanager
    def _writable(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise InputError(f"{self.path}: cannot be written: {error.strerror}") from None

    def _check(self, wanted: Identity) -> None:
        """Refuse a folder of something else, or of another study."""
        marker = self.path / MARKER
        try:
            found = {path.name: path for path in self.path.iterdir()} if self.path.exists() else {}
            strange = sorted(n for n, path in found.items() if n not in BEGUN or _is_full(path))
        except OSError as error:
            raise InputError(f"{self.path}: cannot be read: {error.strerror}") from None
        if MARKER not in found:
            if strange:
                raise InputError(
                    f"{self.path}: holds no study, but {strange[0]}; name a new or empty folder "
                    "by --out"
                )
            return
        with self._another_is_free():
            data = read_json(marker)
            check_version(marker, data)
            own = validated(Identity, marker, data)
            for key in Identity.model_fields:
                was, is_now = getattr(own, key), getattr(wanted, key)
                if was != is_now:
                    raise InputError(
                        f"{self.path}: holds a study of another {key}: {was!r}, not {is_now!r}"
                    )

    @contextmanager
    def _another_is_free(self) -> Iterator[None]:
        try:
            yield
        except InputError as error:
            raise InputError(f"{error}; name another folder by --out") from None

    def record(self, cell: Cell) -> Record | None:
        """What a cell has computed, if it is finished.

        Raises:
            InputError: its file is damaged or of another version.
        """
        path = self._cell_path(cell)
        return read_record(path, cell.key) if path.exists() else None

    def keep(self, cell: Cell, output: Output) -> None:
        """Write down what a cell has computed; it is finished from then on."""
        run = self.path / "runs" / cell.key
        if output.run:
            with self._writable():
                run.mkdir(parents=True, exist_ok=True)
                for leftover in run.iterdir():  # of a study that was killed while it wrote them
                    leftover.unlink()
        for name, data in output.run.items():
            write_atomically(run / name, data)
        write_atomically(self._cell_path(cell), record_to_json(output.record).encode())

    def with_run(self, cell: Cell) -> Cell:
        """The cell with the run that it plays, of one that is trained in another scenario.

        Raises:
            InputError: that training has failed, or its files cannot be read.
        """
        training = cell.training
        if training is None:
            return cell
        if not self._cell_path(training).exists():
            raise InputError(f"its training in {training.scenario.name} failed")
        run = self.path / "runs" / training.key
        try:
            files = {p.name: p.read_bytes() for p in run.iterdir() if not p.name.startswith(LOGS)}
        except OSError as error:
            raise InputError(f"{run}: cannot be read: {error.strerror}") from None
        return replace(cell, run=files)

    def _cell_path(self, cell: Cell) -> Path:
        return self.path / "cells" / f"{cell.key}.json"


def run_study(
    name: str,
    study: Study,
    cells: Sequence[Cell],
    folder: StudyFolder,
    pool: Pool,
    command: str,
    *,
    quick: bool = False,
    console: Console | None = None,
) -> Results:
    """Run what is missing of a study, and put all of it together.

    Args:
        name: of the study.
        study: the study.
        cells: its cells.
        folder: where it is kept; open.
        pool: where cells run.
        command: the command line that does this, for the report.
        quick: whether this is the short form.
        console: where the progress goes; standard error by default.

    Returns:
        the results, which are also in the folder.

    Raises:
        InputError: a finished cell cannot be read, or one cannot be written.
    """
    console = console or progress_console()
    # Trainings that others wait for may be no cells of their own.
    trainings = [cell.training for cell in cells if cell.training is not None]
    wanted = {cell.key: cell for cell in (*trainings, *cells)}
    records = {key: folder.record(cell) for key, cell in wanted.items()}
    missing = [cell for key, cell in wanted.items() if records[key] is None]
    # The longest first, so that no long one is left over for a single process at the end.
    missing.sort(key=lambda cell: -cell.cost)
    failures = []
    if missing:
        finished = len(records) - len(missing)
        console.print(
            f"{len(missing)} cells on {pool.describe()}"
            + (f"; {finished} are there already" if finished else ""),
            highlight=False,
            markup=False,
        )
        with (
            _Progress(console, finished, len(records)) as progress,
            closing(_in_order(missing, folder, pool, study.carbon_g_per_kwh)) as outcomes,
        ):
            for cell, outcome in outcomes:
                if isinstance(outcome, Exception):
                    failures.append(_failure(cell, outcome))
                    progress.tell(cell, f"FAILED: {failures[-1].error}")
                    continue
                folder.keep(cell, outcome)
                records[cell.key] = outcome.record
                progress.tell(cell, f"AoI {outcome.record.mean('mean_aoi'):.2f}")
    done = [
        CellResult(group=c.group, series=c.series, axis=c.axis, record=record)
        for c in cells
        if (record := records[c.key]) is not None
    ]
    results = Results.from_records(name, study, done, failures, command, quick=quick)
    write_atomically(folder.results_path, results.to_json().encode())
    write_atomically(folder.path / "results.csv", results.to_csv().encode())
    return results


def _in_order(
    cells: Sequence[Cell], folder: StudyFolder, pool: Pool, carbon_g_per_kwh: float
) -> Outcomes:
    """Run cells, those that play the runs of others after these."""
    yield from pool.run([c for c in cells if c.trained_in is None], carbon_g_per_kwh)
    ready = []
    for cell in cells:
        if cell.trained_in is not None:
            try:
                ready.append(folder.with_run(cell))
            except InputError as error:
                yield cell, error
    if ready:
        yield from pool.run(ready, carbon_g_per_kwh)


def _failure(cell: Cell, error: Exception) -> Failure:
    reason = (str(error).strip() or type(error).__name__).splitlines()[0]
    if not isinstance(error, InputError):
        reason = f"{type(error).__name__}: {reason}"
    shown = show(reason)[:LONGEST]
    return Failure(series=cell.series, axis=cell.axis, seed=cell.seed, error=shown)


def _is_full(path: Path) -> bool:
    return path.is_dir() and any(path.iterdir())


class _Progress:
    """A bar in a terminal, a line for each cell elsewhere."""

    def __init__(self, console: Console, finished: int, total: int) -> None:
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=None),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            console=console,
            disable=not console.is_terminal,
        )
        self._task = self._bar.add_task("cells", total=total, completed=finished)
        self._done, self._total = finished, total

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def tell(self, cell: Cell, what: str) -> None:
        """A cell has ended."""
        self._done += 1
        self._bar.advance(self._task)
        line = f"{self._done}/{self._total}  {cell.describe()}: {what}"
        self._bar.console.print(line, highlight=False, markup=False)
