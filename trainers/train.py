"""A training from start to end: run folder, logs, checkpoints, signals."""

from __future__ import annotations

import math
import signal
import time
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import torch
from rich.console import Console
from torch import Tensor

import iout_marl
from iout_marl.errors import InputError
from iout_marl.evaluation import Evaluation, evaluate
from iout_marl.files import to_json, user_path
from iout_marl.metrics import described
from iout_marl.scenario import AnyScenario, Overrides, Scenario, load_scenario, to_yaml
from iout_marl.signals import Stopped, StopSignals, nothing_to_save
from iout_marl.terminal import progress_console
from trainers import saving
from trainers.group import Group, LostProcessError
from trainers.logs import TrainingLog, tell
from trainers.memory import enough_memory
from trainers.ppo import Trainer
from trainers.preparing import make_new, new_runs, refuse_to_begin, take_over
from trainers.resuming import is_complete, refuse_to_resume, resumed, runs_in
from trainers.run_folder import RunFolder


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


@dataclass(frozen=True)
class TrainingOutcome:
    """How a training ended; with several policies, each has a run and an evaluation.

    Attributes:
        finished: whether it has taken all steps and been evaluated.
        evaluations: by most probable actions; none where it was stopped, or of another process.
        signal: the number of the signal that stopped it.
        sampled_aoi: mean AoI of each policy in its last rollout with the end of an episode, where
            actions are sampled; None where this process has seen none.
        was_complete: whether a resumed run had nothing left to train.
    """

    runs: list[RunFolder]
    trainer: Trainer
    finished: bool
    seconds: float
    evaluations: list[Evaluation]
    signal: int | None = None
    sampled_aoi: list[float | None] = field(default_factory=list)
    was_complete: bool = False

    @property
    def run(self) -> RunFolder:
        """The run of the first policy."""
        return self.runs[0]

    @property
    def evaluation(self) -> Evaluation | None:
        """The evaluation of the first policy."""
        return self.evaluations[0] if self.evaluations else None


def find_device(name: str) -> torch.device:
    """The device that `--device` means: `auto` is CUDA where there is some, else the CPU.

    Raises:
        InputError: no such device.
    """
    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    try:
        device = torch.device(name)
    except RuntimeError:
        raise InputError(f"--device {name}: unknown device (known: auto, cpu, cuda)") from None
    if device.type not in ("cpu", "cuda"):
        raise InputError(f"--device {name}: unknown device (known: auto, cpu, cuda)")
    if device.type == "cuda" and (
        not torch.cuda.is_available() or (device.index or 0) >= torch.cuda.device_count()
    ):
        raise InputError(f"--device {name}: this machine has no such device")
    return device


def train(
    scenario: AnyScenario,
    out: str | Path,
    seed: int = 0,
    device: torch.device | str = "cpu",
    *,
    resume: bool = False,
    console: Console | None = None,
    evaluation_episodes: int = 100,
    catch_signals: bool = True,
    replicas: int = 1,
    group: Group | None = None,
    use_graphs: bool = True,
    overrides: Overrides = None,
) -> TrainingOutcome:
    """Train a policy, or several side by side, and evaluate at the end.

    Args:
        scenario: what to train on, and how: whatever `load_scenario` takes.
        out: the run's folder; of several policies, that of their folders, `seed-N` each.
        seed: seeds the training; a resumed one goes on with its own.
        device: where to train.
        resume: go on with the run, or the runs, in `out`. One that has taken its steps is
            evaluated; one that is complete stays as it is.
        console: where the progress goes; standard error by default.
        evaluation_episodes: episodes of the final evaluation.
        catch_signals: on SIGHUP, SIGINT and SIGTERM, finish the running iteration and save
            everything, so that the training can be resumed. Otherwise, and as long as the
            training is only being built, they have their usual effect.
        replicas: how many policies, from the seed on; a resumed training has those it had.
        group: the processes that train together, each of which calls this; the first one
            writes and evaluates.
        use_graphs: on a CUDA device, record the work as CUDA graphs.
        overrides: changes of the scenario, as for `load_scenario`.

    Raises:
        DivergedError: weights or losses are no longer finite; nothing of it is saved.
        InputError: `out` holds a run already, or files of others under names that a run writes
            (or, to resume, no run, or one of another scenario); another process trains in it;
            or it cannot be written; another process of
            the group was lost; there is too little memory; or the work could not be recorded as
            CUDA graphs.
    """
    started = time.perf_counter()
    scenario = load_scenario(scenario, overrides)
    out = user_path(out, "out")
    console, group = console or progress_console(), group or Group()
    with enough_memory(f"{out}: "), ExitStack() as held:
        with nothing_to_save(catch=catch_signals):
            if resume:
                runs = runs_in(out)
                is_together = runs[0].path != out
                check = partial(refuse_to_resume, runs, scenario, is_together=is_together)
                take_over(out, runs, group, held, check)
                trainer = resumed(
                    *(runs, scenario, torch.device(device), group),
                    is_together=is_together,
                    use_graphs=use_graphs,
                )
            else:
                runs = new_runs(out, seed, replicas)
                refuse_to_begin(out, runs, group)
                trainer = Trainer(scenario, seed, device, replicas, group, use_graphs=use_graphs)
                make_new(out, runs, group, held)
        stop = held.enter_context(StopSignals(catch=catch_signals))
        if resume and group.rank == 0:
            for run in runs:
                saving.settle(run.path)
        saved_at = trainer.env_steps if resume else None
        training = _Training(out, runs, trainer, scenario, console, stop, saved_at)
        was_complete = resume and is_complete(runs, trainer)
        if was_complete:
            tell(console, f"{out}: is complete; its policy is evaluated again")
        else:
            _say_how_far(trainer, console)
            training.run()
        seconds = time.perf_counter() - started
        evaluations: list[Evaluation] = []
        if trainer.finished and group.rank == 0:
            with suppress(Stopped):  # all steps are saved
                evaluations = training.evaluated(evaluation_episodes)
            if evaluations and not was_complete:
                training.save_results(evaluations, seconds)
        finished = bool(evaluations) if group.rank == 0 else trainer.finished
        return TrainingOutcome(
            runs,
            trainer,
            finished,
            seconds,
            evaluations,
            stop.number,
            training.sampled_aoi,
            was_complete,
        )


def _say_how_far(trainer: Trainer, console: Console) -> None:
    steps, each = trainer.settings.steps, trainer.steps_per_iteration
    if trainer.group.rank == 0 and steps % each:
        tell(
            console,
            f"training.steps {steps:,}: {-(-steps // each) * each:,} are trained, whole rollouts "
            f"of {each:,} steps",
        )


class _Training:
    """A training whose folders are ready and are this process's alone."""

    def __init__(
        self,
        out: Path,
        runs: list[RunFolder],
        trainer: Trainer,
        source: Scenario,
        console: Console,
        stop: StopSignals,
        saved_at: int | None,
    ) -> None:
        self._out = out
        self._runs = runs
        self._trainer = trainer
        self._source = source
        self._console = console
        self._stop = stop
        self._group_folder = None if runs[0].path == out else out
        self._scenarios = [to_yaml(scenario).encode() for scenario in trainer.scenarios]
        #: Steps of the last save, and of the last one by this process; None where there is none.
        self._saved_at = saved_at
        self._saved_here_at: int | None = None
        self.sampled_aoi: list[float | None] = [None] * len(runs)

    def run(self) -> None:
        """Take the steps that are left, or as many as there are before a signal, and save."""
        try:
            self._iterate()
        except LostProcessError as error:
            if self._stop.catch:
                # torchrun now ends those that are left: not before this one has said why.
                signal.signal(signal.SIGTERM, signal.SIG_IGN)
            raise InputError(
                f"{self._out}: {error} after {self._trainer.env_steps:,} environment steps; "
                f"{_last(self._saved_at)}"
            ) from None

    def _iterate(self) -> None:
        trainer, group, stop = self._trainer, self._trainer.group, self._stop
        every = trainer.settings.checkpoint_steps
        steps, name = trainer.settings.steps, self._source.name
        mean_aoi = described("mean_aoi").tag
        failure: InputError | None = None
        writing = self._runs if group.rank == 0 else []
        with TrainingLog(writing, name, steps, trainer.env_steps, self._console) as log:
            # Only together: a process alone would wait for the others without end.
            while not group.any(failure is not None or stop.number is not None):
                if trainer.finished:
                    break
                figures = trainer.iterate_all()
                try:
                    log.write(trainer.env_steps, figures)
                except InputError as error:
                    failure = error  # what was learnt is saved all the same
                self._check_finite(figures)
                self.sampled_aoi = [
                    each.get(mean_aoi, last)
                    for each, last in zip(figures, self.sampled_aoi, strict=True)
                ]
                if trainer.env_steps - (self._saved_at or 0) >= every:
                    self._save()
            if self._saved_here_at != trainer.env_steps:
                try:
                    self._save()
                except InputError:
                    if failure is None:
                        raise
            stop.number = group.largest(stop.number or 0) or None
            if failure is not None:
                raise InputError(f"{failure}; {_last(self._saved_at)}") from None

    def _save(self) -> None:
        """Save every policy, or none: all processes gather what the first one writes."""
        files = {}
        for i, run in enumerate(self._runs):
            state = self._trainer.state_dict(i)
            if not _is_finite([state["network"], state["optimizer"]]):
                raise DivergedError(run.path, self._trainer.env_steps, self._saved_at)
            if self._trainer.group.rank == 0:
                files[run.path] = {
                    "scenario.yaml": self._scenarios[i],
                    **run.saved_files(self._trainer, state, self._source, i),
                }
        if files:
            saving.save(files, self._group_folder)
        self._saved_at = self._saved_here_at = self._trainer.env_steps

    def _check_finite(self, figures: list[dict[str, float]]) -> None:
        for run, log in zip(self._runs, figures, strict=True):
            if not math.isfinite(log["ppo/loss"] + log["ppo/gradient_norm"]):
                raise DivergedError(run.path, self._trainer.env_steps, self._saved_at)
            for metric in self._trainer.simulation.world.measured:
                value = log.get(metric.tag, 0.0)
                if not metric.is_builtin and not math.isfinite(value):
                    raise InputError(
                        f"{run.path}: metric {metric.name}: must be finite, not {value}, after "
                        f"{self._trainer.env_steps:,} environment steps; {_last(self._saved_at)}"
                    )

    def evaluated(self, episodes: int) -> list[Evaluation]:
        """The evaluation of every policy; none where a signal has come.

        Raises:
            Stopped: one comes meanwhile.
        """
        trainer, evaluations = self._trainer, []
        self._stop.at_once = True
        if self._stop.number is not None:
            return []
        for i, (run, pinned) in enumerate(zip(self._runs, trainer.scenarios, strict=True)):
            policy = trainer.policy(i, str(run.path))
            evaluations.append(evaluate(pinned, policy, episodes, seed=0))
        self._stop.at_once = False
        return evaluations

    def save_results(self, evaluations: list[Evaluation], seconds: float) -> None:
        """Add `result.json` to what was saved."""
        results = {
            run.path: {"result.json": _result(self._trainer, i, evaluation, seconds).encode()}
            for i, (run, evaluation) in enumerate(zip(self._runs, evaluations, strict=True))
        }
        saving.save(results, self._group_folder, adds=True)


def _last(saved_at: int | None) -> str:
    """What there is to go on from."""
    if saved_at is None:
        return "nothing was saved yet"
    return f"last checkpoint: {saved_at:,} steps"


def _is_finite(state: Any) -> bool:
    if isinstance(state, Mapping):
        return _is_finite(list(state.values()))
    if isinstance(state, list):
        return all(map(_is_finite, state))
    return not isinstance(state, Tensor) or bool(state.isfinite().all())


def _result(trainer: Trainer, policy: int, evaluation: Evaluation, seconds: float) -> str:
    result = {
        "version": iout_marl.__version__,
        "torch": torch.__version__,
        "device": str(trainer.device),
        "seed": trainer.seeds[policy],
        "env_steps": trainer.env_steps,
        "seconds": round(seconds, 3),
        "evaluation": evaluation.to_json(),
    }
    return to_json(result, indent=2) + "\n"
