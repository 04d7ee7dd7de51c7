"""A training as it goes: iterations, callbacks, saves, signals, the final evaluation."""

from __future__ import annotations

import math
import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from functools import partial
from pathlib import Path

import torch
from rich.console import Console

import iout_marl
from iout_marl.errors import InputError
from iout_marl.evaluation import Evaluation, evaluate
from iout_marl.files import to_json
from iout_marl.metrics import described
from iout_marl.registry import blamed
from iout_marl.signals import StopSignals
from trainers.accel.group import LostProcessError
from trainers.callbacks import Callback
from trainers.logs import ProgressBar, TrainingLog, tell
from trainers.ppo import Trainer
from trainers.runs import saving
from trainers.runs.folder import RunFolder
from trainers.runs.writing import NotFiniteError, write_runs


class DivergedError(InputError):
    """A training has come to numbers that are not finite.

    Attributes:
        reason: the message without the run's folder and what is in it.
    """

    def __init__(self, folder: Path, env_steps: int, saved_at: int | None) -> None:
        self.reason = (
            f"training diverged after {env_steps:,} environment steps "
            "(a smaller training.learning_rate may help)"
        )
        super().__init__(f"{folder}: {self.reason}; {_last(saved_at)}")


class SaveError(InputError):
    """What was learnt could not be saved."""


class CheckpointWriter(Callback):
    """Saves the runs every `training.checkpoint_steps`."""

    def on_iteration(self, training: TrainingRun) -> None:
        """Save, if it is time."""
        trainer = training.trainer
        if trainer.env_steps - (training.saved_at or 0) >= trainer.settings.checkpoint_steps:
            training.save()


class TrainingRun:
    """A training as it goes: what callbacks are given.

    Attributes:
        trainer: what is trained.
        runs: the folder of each policy.
        console: where the progress goes.
        figures: what the last iteration has logged of each policy, by TensorBoard tag.
        evaluations: the final evaluation of each policy, at the end and in the first process.
        failure: what has ended the training before its time, if anything.
        saved_at: environment steps of the last save; None where there is none.
        sampled_aoi: see `TrainingOutcome`.
    """

    def __init__(
        self,
        out: Path,
        runs: list[RunFolder],
        trainer: Trainer,
        console: Console,
        signals: StopSignals,
        callbacks: Sequence[Callback],
        *,
        is_resumed: bool,
    ) -> None:
        self.trainer = trainer
        self.runs = runs
        self.console = console
        self.figures: list[dict[str, float]] = []
        self.evaluations: list[Evaluation] = []
        self.failure: BaseException | None = None
        self.saved_at = trainer.env_steps if is_resumed else None
        self.sampled_aoi: list[float | None] = [None] * len(runs)
        self._out = out
        self._group = trainer.runtime.group
        self._group_folder = None if runs[0].path == out else out
        self._signals = signals
        self._callbacks = (TrainingLog(), ProgressBar(), *callbacks, CheckpointWriter())
        self._started: list[Callback] = []
        self._is_stopped = False
        #: Steps of the last save by this process; None where there is none.
        self._saved_here_at: int | None = None

    @property
    def is_first(self) -> bool:
        """Whether this process is the first of those that train together, which writes."""
        return self._group.rank == 0

    @property
    def is_done(self) -> bool:
        """Whether all steps have been taken, or a callback has stopped the training."""
        return self.trainer.finished or self._is_stopped

    def stop(self) -> None:
        """End after this iteration as if all steps had been taken: save and evaluate."""
        self._is_stopped = True

    def save(self) -> None:
        """Save now; several processes do so together, or not at all.

        Raises:
            DivergedError: weights or losses are no longer finite.
            SaveError: a file cannot be written; the save before is as it was.
        """
        self._check_finite()
        try:
            write_runs(self.trainer, self.runs, self._group_folder)
        except NotFiniteError as error:
            raise DivergedError(error.run.path, self.trainer.env_steps, self.saved_at) from None
        except InputError as error:
            raise SaveError(str(error)) from None
        self.saved_at = self._saved_here_at = self.trainer.env_steps
        self._call("on_checkpoint")

    @contextmanager
    def under_way(self) -> Iterator[None]:
        """Calls `on_start` before what is done meanwhile, and `on_end` after it."""
        try:
            self._call_and_explain("on_start")
            yield
        except BaseException as error:
            self.failure = error
            raise
        finally:
            with suppress(InputError) if self.failure else nullcontext():
                self._call_and_explain("on_end")

    def _call_and_explain(self, event: str) -> None:
        try:
            self._call(event)
        except InputError as error:
            raise InputError(f"{error}; {_last(self.saved_at)}") from None

    def _call(self, event: str) -> None:
        """Call all callbacks, in every process whatever one of them raises.

        Raises:
            InputError: what the first of them has raised.
        """
        if event == "on_start":
            self._started = []
        failures = []
        for callback in self._callbacks if event != "on_end" else self._started:
            if event == "on_start":
                self._started.append(callback)
            try:
                _call_one(callback, event, self)
            except (DivergedError, SaveError):
                raise
            except InputError as error:
                failures.append(error)
        if failures:
            raise failures[0]

    def run(self) -> None:
        """Take the steps that are left, or as many as there are before a signal, and save."""
        try:
            self._iterate()
        except LostProcessError as error:
            # torchrun now ends those that are left: not before this one has said why.
            self._signals.ignore(signal.SIGTERM)
            raise InputError(
                f"{self._out}: {error} after {self.trainer.env_steps:,} environment steps; "
                f"{_last(self.saved_at)}"
            ) from None

    def _iterate(self) -> None:
        trainer, group, signals = self.trainer, self._group, self._signals
        failure: InputError | None = None
        # Only together: a process alone would wait for the others without end.
        while not group.any(failure is not None or signals.number is not None):
            if group.any(self.is_done):
                self._is_stopped = not trainer.finished
                break
            self.figures = trainer.iterate_all()
            try:
                self._call("on_iteration")
            except (DivergedError, SaveError):
                raise
            except InputError as error:
                failure = error  # what was learnt is saved all the same
            self._check_finite()
            if not trainer.settings.over:  # whose rollouts are of other scenarios
                tag = described("mean_aoi").tag
                self.sampled_aoi = [
                    each.get(tag, last)
                    for each, last in zip(self.figures, self.sampled_aoi, strict=True)
                ]
        if self._saved_here_at != trainer.env_steps:
            try:
                self.save()
            except InputError as error:
                failure = failure or error
        signals.number = group.largest(signals.number or 0) or None
        if isinstance(failure, SaveError | DivergedError):
            raise failure
        if failure is not None:
            raise InputError(f"{failure}; {_last(self.saved_at)}") from None
        if self._is_stopped and self.is_first:
            tell(self.console, f"{self._out}: stopped by a callback at {trainer.env_steps:,} steps")

    def _check_finite(self) -> None:
        for run, log in zip(self.runs, self.figures, strict=bool(self.figures)):
            if not math.isfinite(log["ppo/loss"] + log["ppo/gradient_norm"]):
                raise DivergedError(run.path, self.trainer.env_steps, self.saved_at)
            for metric in self.trainer.collector.world.measured:
                value = log.get(metric.tag, 0.0)
                if not metric.is_builtin and not math.isfinite(value):
                    raise InputError(
                        f"{run.path}: metric {metric.name}: must be finite, not {value}, after "
                        f"{self.trainer.env_steps:,} environment steps; {_last(self.saved_at)}"
                    )

    def evaluate(self, episodes: int) -> None:
        """Evaluate every policy; none where a signal has come.

        Raises:
            Stopped: one comes meanwhile.
        """
        self._signals.at_once = True
        if self._signals.number is not None or not self.is_first:
            return
        found = []
        for i, (run, pinned) in enumerate(zip(self.runs, self.trainer.scenarios, strict=True)):
            policy = self.trainer.policy(i, str(run.path))
            found.append(evaluate(pinned, policy, episodes, seed=0))
        self._signals.at_once = False
        self.evaluations = found

    def save_results(self, seconds: float) -> None:
        """Add `result.json` to what was saved."""
        results = {
            run.path: {"result.json": _result(self.trainer, i, evaluation, seconds).encode()}
            for i, (run, evaluation) in enumerate(zip(self.runs, self.evaluations, strict=True))
        }
        saving.save(results, self._group_folder, adds=True)


def _call_one(callback: Callback, event: str, training: TrainingRun) -> None:
    call = partial(getattr(callback, event), training)
    if type(callback).__module__.partition(".")[0] == __package__:
        call()
        return
    try:
        with blamed(f"callback {type(callback).__name__}", type(callback)):
            call()
    except InputError as error:
        if isinstance(error.__cause__, LostProcessError):
            raise error.__cause__ from None
        raise


def _last(saved_at: int | None) -> str:
    """What there is to continue from."""
    if saved_at is None:
        return "nothing was saved yet"
    return f"last checkpoint: {saved_at:,} steps"


def _result(trainer: Trainer, policy: int, evaluation: Evaluation, seconds: float) -> str:
    result = {
        "version": iout_marl.__version__,
        "torch": torch.__version__,
        "device": str(trainer.runtime.device),
        "seed": trainer.seeds[policy],
        "env_steps": trainer.env_steps,
        "seconds": round(seconds, 3),
        "evaluation": evaluation.to_json(),
    }
    return to_json(result, indent=2) + "\n"
