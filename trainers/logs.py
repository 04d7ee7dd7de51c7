"""Callbacks that report how a training goes: to TensorBoard, a log file, the terminal."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from statistics import fmean
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from torch.utils.tensorboard import SummaryWriter

from iout_marl.errors import InputError
from iout_marl.files import reason, to_json, write_atomically
from iout_marl.metrics import described
from trainers.callbacks import Callback
from trainers.runs.folder import RunFolder
from trainers.runs.metrics import damaged_lines, read_rows, row

if TYPE_CHECKING:
    from trainers.training_run import TrainingRun

#: Metrics that the terminal shows, by the name of their field.
_SHOWN = {"aoi": described("mean_aoi"), "jain": described("jain"), "kj": described("harvested_kj")}
#: Seconds between two lines where there is no terminal to draw a bar in.
LINE_EVERY_S = 10.0


def unfailing() -> suppress:
    """For what is only shown: a terminal that has gone costs no training."""
    return suppress(OSError, ValueError)


def tell(console: Console, line: str) -> None:
    """Show a line as it is, in one piece."""
    with unfailing():
        console.print(line, markup=False, highlight=False, emoji=False, soft_wrap=True)


class TrainingLog(Callback):
    """Writes each iteration to TensorBoard and to `metrics.jsonl`, in the first process.

    All figures are of sampled actions, by which a policy learns, not of its most probable ones.
    With them goes `speed/logging_share`: what part of the time since the last iteration was
    logged has gone into logging that one.
    """

    def on_start(self, training: TrainingRun) -> None:
        """Open the files; what they say of later steps than those taken is cut off."""
        self._runs: list[_RunLog] = []
        self._last_write, self._writing_s = time.monotonic(), 0.0
        # TensorBoard's thread dies of a full disk with a traceback; `on_iteration` and `on_end`
        # raise the same error once more, which is then reported in one line.
        self._usual_hook = threading.excepthook
        threading.excepthook = self._without_tensorboard
        for run in training.runs if training.is_first else ():
            self._runs.append(_RunLog(run, training.trainer.env_steps, training.console))

    def on_iteration(self, training: TrainingRun) -> None:
        """Write the figures."""
        now = time.monotonic()
        share = self._writing_s / max(now - self._last_write, 1e-9)
        self._last_write = now
        for run, log in zip(self._runs, training.figures, strict=bool(self._runs)):
            run.write(training.trainer.env_steps, {**log, "speed/logging_share": share})
        self._writing_s = time.monotonic() - now

    def on_end(self, training: TrainingRun) -> None:
        """Close the files."""
        try:
            for run in self._runs:
                run.close(quietly=training.failure is not None)
        finally:
            threading.excepthook = self._usual_hook

    def _without_tensorboard(self, failure: threading.ExceptHookArgs) -> None:
        if type(failure.thread).__name__ != "_AsyncWriterThread":
            self._usual_hook(failure)


class ProgressBar(Callback):
    """Shows in the first process's terminal how far a training is; elsewhere, a line at times."""

    def on_start(self, training: TrainingRun) -> None:
        """Draw the bar."""
        trainer, console = training.trainer, training.console
        self._last_line = time.monotonic()
        self._progress = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=None),
            TextColumn("{task.percentage:>3.0f} %"),
            TextColumn(f"sampled AoI {{task.fields[aoi]:6.{_SHOWN['aoi'].digits}f}}"),
            TextColumn(f"Jain {{task.fields[jain]:.{_SHOWN['jain'].digits}f}}"),
            TextColumn(f"{{task.fields[kj]:5.{_SHOWN['kj'].digits}f}} {_SHOWN['kj'].unit}"),
            TextColumn("{task.fields[rate]:>7,.0f} steps/s"),
            TimeRemainingColumn(),
            console=console,
            disable=not console.is_terminal or not training.is_first,
        )
        self._task = self._progress.add_task(
            training.trainer.source.name,
            total=trainer.settings.steps,
            completed=trainer.env_steps,
            aoi=0.0,
            jain=0.0,
            kj=0.0,
            rate=0.0,
        )
        with unfailing():
            self._progress.start()

    def on_iteration(self, training: TrainingRun) -> None:
        """Move it on."""
        if training.is_first:
            with unfailing():
                self._show(training)

    def on_end(self, training: TrainingRun) -> None:  # noqa: ARG002
        """Leave it as it is."""
        with unfailing():
            self._progress.stop()

    def _show(self, training: TrainingRun) -> None:
        env_steps, total = training.trainer.env_steps, training.trainer.settings.steps
        figures = training.figures
        log = {tag: fmean(log[tag] for log in figures) for tag in figures[0]}
        fields = {"rate": log["speed/env_steps_per_s"]}
        if _SHOWN["aoi"].tag in log:
            fields |= {field: log[metric.tag] for field, metric in _SHOWN.items()}
        self._progress.update(self._task, completed=env_steps, **fields)  # type: ignore[arg-type]
        now, console = time.monotonic(), training.console
        done = env_steps >= total
        if not console.is_terminal and (done or now - self._last_line >= LINE_EVERY_S):
            self._last_line = now
            shown: dict[str, Any] = self._progress.tasks[0].fields
            aoi, jain, kj = (f"{shown[key]:.{metric.digits}f}" for key, metric in _SHOWN.items())
            name = training.trainer.source.name
            tell(
                console,
                f"{name}  {min(env_steps / total, 1):4.0%}  sampled AoI {aoi}  "
                f"Jain {jain}  {kj} {_SHOWN['kj'].unit}  {shown['rate']:,.0f} steps/s",
            )


class _RunLog:
    """The log files of one run."""

    def __init__(self, run: RunFolder, env_steps: int, console: Console) -> None:
        self._run = run
        _cut_off(run, env_steps, console)
        purge_step = env_steps + 1 if env_steps else None  # of the steps that it hides, the first
        with self._written():
            self._writer = SummaryWriter(str(run.path), purge_step=purge_step)
            self._metrics = run.metrics_path.open("a", encoding="utf-8")

    def write(self, env_steps: int, log: dict[str, float]) -> None:
        with self._written():
            self._metrics.write(row(env_steps, log))
            self._metrics.flush()
            for tag, value in log.items():
                self._writer.add_scalar(tag, value, env_steps)

    def close(self, *, quietly: bool) -> None:
        try:
            with self._written():
                self._metrics.close()
            with self._written():
                self._writer.close()
        except InputError:
            if not quietly:
                raise

    @contextmanager
    def _written(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise InputError(f"{self._run.path}: cannot be written: {reason(error)}") from None


def _cut_off(run: RunFolder, env_steps: int, console: Console) -> None:
    """Drop the rows of iterations after the checkpoint that training continues from."""
    path = run.metrics_path
    rows, skipped = read_rows(path)
    if skipped:
        tell(console, damaged_lines(path, skipped))
    kept = [each for each in rows if each["env_steps"] <= env_steps]
    if rows or skipped:
        write_atomically(path, "".join(to_json(each) + "\n" for each in kept).encode())
