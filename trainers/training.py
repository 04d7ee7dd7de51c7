"""A training from start to end: run folder, logs, checkpoints, signals."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import torch
from rich.console import Console

from iout_marl.errors import InputError
from iout_marl.evaluation import Evaluation
from iout_marl.files import user_path
from iout_marl.scenario import AnyScenario, Overrides
from iout_marl.signals import Stopped, StopSignals, nothing_to_save
from iout_marl.terminal import progress_console
from iout_marl.whole import seed_argument, whole_argument
from trainers.accel.group import ProcessGroup
from trainers.base import load_for_training
from trainers.callbacks import Callback
from trainers.logs import tell
from trainers.memory import enough_memory
from trainers.ppo import Trainer
from trainers.runs import saving
from trainers.runs.folder import RunFolder
from trainers.runs.preparing import make_new, new_runs, refuse_to_begin, take_over
from trainers.runs.resuming import is_complete, refuse_to_resume, resumed, runs_in
from trainers.starting import started_from
from trainers.training_run import TrainingRun


@dataclass(frozen=True)
class TrainingOutcome:
    """How a training ended; with several policies, each has a run and an evaluation.

    Attributes:
        finished: whether it has taken all steps, or was stopped by a callback, and been evaluated.
        evaluations: by most probable actions; none where it was stopped, or of another process.
        signal: the number of the signal that stopped it.
        sampled_aoi: mean AoI of each policy in its last rollout with the end of an episode, where
            actions are sampled; None where this process has seen none, and with `training.over`.
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
    group: ProcessGroup | None = None,
    use_graphs: bool = True,
    overrides: Overrides = None,
    network: str | dict[str, Any] | None = None,
    start: str | None = None,
    callbacks: Sequence[Callback] = (),
) -> TrainingOutcome:
    """Train a policy, or several side by side, and evaluate at the end.

    Args:
        scenario: what to train on, and how: whatever `load_scenario` takes.
        out: the run's folder; of several policies, that of their folders, `seed-N` each.
        seed: seeds the training; a resumed one continues with its own.
        device: where to train.
        resume: continue with the run, or the runs, in `out`. One that has taken its steps is
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
        network: in place of `training.network`: the kind of a registered one, or a mapping with
            it and its settings.
        start: what the weights begin with, see `BaseTrainer`.
        callbacks: what is called beside the log, the progress bar and the writer of checkpoints.

    Raises:
        DivergedError: weights or losses are no longer finite; nothing of it is saved.
        InputError: a number is none, or out of its range; `out` holds a run already, or files of
            others under names that a run writes (or, to resume, no run, or one of another
            scenario); another process trains in it; or it cannot be written; another process of
            the group was lost; there is too little memory; or the work could not be recorded as
            CUDA graphs.
    """
    started, given = time.perf_counter(), scenario
    replicas = whole_argument("replicas", replicas, 1)
    seed = seed_argument(seed, replicas)
    evaluation_episodes = whole_argument("evaluation_episodes", evaluation_episodes, 1)
    if start is None:
        scenario = load_for_training(scenario, overrides, network)
    else:
        scenario, _ = started_from(start, scenario, overrides, network)
    _check_callbacks(callbacks)
    out = user_path(out, "out")
    console, group = console or progress_console(), group or ProcessGroup()
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
                # Weights come along with what is said anew: see `started_from`.
                changes: dict[str, Any] = {}
                if start is not None:
                    changes = {"overrides": overrides, "network": network, "start": start}
                trainer = Trainer(
                    *(given if start else scenario, seed, device, replicas, group),
                    use_graphs=use_graphs,
                    **changes,
                )
                trainer.check_imitation()
                make_new(out, runs, trainer.scenarios, group, held)
        signals = held.enter_context(StopSignals(catch=catch_signals))
        if resume and group.rank == 0:
            for run in runs:
                saving.settle(run.path)
        training = TrainingRun(out, runs, trainer, console, signals, callbacks, is_resumed=resume)
        was_complete = resume and is_complete(runs, trainer)
        if was_complete:
            tell(console, f"{out}: is complete; its policy is evaluated again")
            with suppress(Stopped):
                training.evaluate(evaluation_episodes)
        else:
            _say_how_far(trainer, console)
            with training.under_way():
                training.run()
                seconds = time.perf_counter() - started
                if training.is_done and training.is_first:
                    with suppress(Stopped):  # all steps are saved
                        training.evaluate(evaluation_episodes)
                    if training.evaluations:
                        training.save_results(seconds)
        if was_complete:
            seconds = time.perf_counter() - started
        return TrainingOutcome(
            runs,
            trainer,
            bool(training.evaluations) if training.is_first else training.is_done,
            seconds,
            training.evaluations,
            signals.number,
            training.sampled_aoi,
            was_complete,
        )


def _check_callbacks(callbacks: Any) -> None:
    for callback in callbacks:
        if not isinstance(callback, Callback):
            name = getattr(callback, "__name__", type(callback).__name__)
            raise InputError(
                f"callbacks: {name} must be an object of a class that extends trainers.Callback"
            )


def _say_how_far(trainer: Trainer, console: Console) -> None:
    steps, each = trainer.settings.steps, trainer.steps_per_iteration
    # Their rollouts differ.
    is_exact = not trainer.settings.over and trainer.settings.imitate is None
    if trainer.runtime.group.rank == 0 and steps % each and is_exact:
        tell(
            console,
            f"training.steps {steps:,}: {-(-steps // each) * each:,} are trained, whole rollouts "
            f"of {each:,} steps",
        )
