"""A training from start to end: run folder, logs, checkpoints, signals."""

from __future__ import annotations

import json
import math
import re
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

import torch
from rich.console import Console

import iout_marl
from iout_marl.errors import InputError
from iout_marl.evaluation import Evaluation, evaluate
from iout_marl.files import write_together
from iout_marl.scenario import Scenario
from trainers.group import Group, LostProcessError
from trainers.loading import differences
from trainers.logs import TrainingLog
from trainers.ppo import Trainer
from trainers.run_folder import RunFolder, readable

#: Settings that a resumed run may change.
CHANGEABLE = ("training.steps", "training.checkpoint_steps")


@dataclass(frozen=True)
class TrainingOutcome:
    """How a training ended; with several policies, each has a run and an evaluation."""

    runs: list[RunFolder]
    trainer: Trainer
    finished: bool
    seconds: float
    evaluations: list[Evaluation]  # none where it was stopped, or of another process

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
    scenario: Scenario,
    out: Path,
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
) -> TrainingOutcome:
    """Train a policy, or several side by side, and evaluate at the end.

    Args:
        scenario: what to train on, and how.
        out: the run's folder; of several policies, that of their folders, `seed-N` each.
        seed: seeds the training; a resumed one goes on with its own.
        device: where to train.
        resume: go on with the run, or the runs, in `out`.
        console: where the progress goes; standard error by default.
        evaluation_episodes: episodes of the final evaluation.
        catch_signals: on SIGINT and SIGTERM, finish the running iteration and save everything,
            so that the training can be resumed. Otherwise they have their usual effect.
        replicas: how many policies, from the seed on; a resumed training has those it had.
        group: the processes that train together, each of which calls this; the first one
            writes and evaluates.
        use_graphs: on a CUDA device, record the work as CUDA graphs.

    Raises:
        InputError: `out` holds a run already (or, to resume, none, or one of another
            scenario), or cannot be written; another process of the group was lost; or the
            work could not be recorded as CUDA graphs.
    """
    started = time.perf_counter()
    console = console or Console(stderr=True)
    group = group or Group()
    if resume:
        runs = _runs_in(out)
        together = runs[0].path != out
        trainer = _resumed(
            runs,
            scenario,
            torch.device(device),
            group,
            is_together=together,
            use_graphs=use_graphs,
        )
    else:
        trainer = Trainer(scenario, seed, device, replicas, group, use_graphs=use_graphs)
        runs = [RunFolder(path) for path in _paths(out, trainer)]
    writes = group.rank == 0
    with _all_or_none(group):
        if writes and not resume:
            _refuse_if_used(out, runs)
            for run, pinned in zip(runs, trainer.scenarios, strict=True):
                run.create(pinned)
    saved_at = trainer.env_steps
    steps = trainer.settings.steps
    try:
        with (
            TrainingLog(
                runs if writes else [], scenario.name, steps, trainer.env_steps, console
            ) as log,
            _stop_signals(catch=catch_signals) as signals,
        ):
            # Only together: a process alone would wait for the others without end.
            while not trainer.finished and not group.any(bool(signals)):
                figures = trainer.iterate_all()
                log.write(trainer.env_steps, figures)
                _check_finite(figures, runs, trainer.env_steps, saved_at)
                if trainer.env_steps - saved_at >= trainer.settings.checkpoint_steps:
                    _save(runs, trainer, scenario)
                    saved_at = trainer.env_steps
            _save(runs, trainer, scenario)
    except torch.OutOfMemoryError:
        raise InputError(
            f"{out}: not enough memory on {trainer.device}: fewer training.environments, "
            "training.rollout_slots or --replicas take less"
        ) from None
    except LostProcessError as error:
        if catch_signals:
            # torchrun now ends those that are left: not before this one has said why.
            signal.signal(signal.SIGTERM, signal.SIG_IGN)
        stands = f"the checkpoint of {saved_at:,} steps stands" if saved_at else "nothing was saved"
        raise InputError(
            f"{out}: {error} after {trainer.env_steps:,} environment steps; {stands}"
        ) from None
    seconds = time.perf_counter() - started
    evaluations = []
    if trainer.finished and writes:
        for i, (run, pinned) in enumerate(zip(runs, trainer.scenarios, strict=True)):
            policy = trainer.policy(i, str(run.path))
            evaluation = evaluate(pinned, policy, evaluation_episodes, seed=0)
            run.write_text("result.json", _result(trainer, i, evaluation, seconds))
            evaluations.append(evaluation)
    return TrainingOutcome(runs, trainer, trainer.finished, seconds, evaluations)


def _paths(out: Path, trainer: Trainer) -> list[Path]:
    """The folder of a lone run, or one within it for each of several policies."""
    seeds = trainer.seeds
    return [out] if len(seeds) == 1 else [out / f"seed-{seed}" for seed in seeds]


def _refuse_if_used(out: Path, runs: list[RunFolder]) -> None:
    """Leave alone what is there, before anything new is made."""
    for run in (RunFolder(out), *_several_in(out), *runs):
        run.refuse_if_used()


def _several_in(out: Path) -> list[RunFolder]:
    """The runs of policies that were trained side by side, by seed."""
    try:
        folders = [path.parent.name for path in out.glob("*/scenario.yaml")]
    except OSError as error:
        raise InputError(f"{out}: cannot be read: {error.strerror}") from None
    matches = (re.fullmatch(r"seed-(\d+)", name) for name in folders)
    seeds = sorted(int(match[1]) for match in matches if match)
    return [RunFolder(out / f"seed-{seed}") for seed in seeds]


def _runs_in(out: Path) -> list[RunFolder]:
    """The run in a folder, or those of several policies within it."""
    several = _several_in(out)
    return several if several and not (out / "scenario.yaml").is_file() else [RunFolder(out)]


@contextmanager
def _all_or_none(group: Group) -> Iterator[None]:
    """What the first process begins with: if it fails, so do the others, with less to say."""
    failure = None
    try:
        yield
    except InputError as error:
        failure = error
    try:
        is_refused = group.any(failure is not None)
    except LostProcessError:
        is_refused = True
    if is_refused:
        raise failure or InputError("the first process could not begin")


def _save(runs: list[RunFolder], trainer: Trainer, source: Scenario) -> None:
    """Save every policy, or none: all processes gather what the first one writes."""
    files: dict[Path, bytes] = {}
    for i, run in enumerate(runs):
        state = trainer.state_dict(i)
        if trainer.group.rank == 0:
            files |= run.saved_files(trainer, state, source, i)
    if files:
        write_together(files)


def _check_finite(
    figures: list[dict[str, float]], runs: list[RunFolder], env_steps: int, saved_at: int
) -> None:
    for run, log in zip(runs, figures, strict=True):
        if not math.isfinite(log["ppo/loss"] + log["ppo/gradient_norm"]):
            raise InputError(
                f"{run.path}: training diverged after {env_steps:,} environment "
                f"steps; the checkpoint of {saved_at:,} steps stands"
            )


def _resumed(
    runs: list[RunFolder],
    scenario: Scenario,
    device: torch.device,
    group: Group,
    *,
    is_together: bool,
    use_graphs: bool,
) -> Trainer:
    scenarios = [run.scenario() for run in runs]
    saved = [run.load_checkpoint(device) for run in runs]
    with readable(runs[0].checkpoint_path):
        seeds = [int(one["seed"]) for one in saved]
        first, count = saved[0]["side_by_side"]
        alike = len({(int(one["env_steps"]), *one["side_by_side"]) for one in saved}) == 1
    if is_together and not (alike and seeds == list(range(first, first + count))):
        raise InputError(
            f"{runs[0].path.parent}: these runs have not come equally far, or some are missing; "
            "go on with each by its own folder"
        )
    trainer = Trainer(scenario, seeds[0], device, len(seeds), group, use_graphs=use_graphs)
    for run, own, wanted in zip(runs, scenarios, trainer.scenarios, strict=True):
        strange = [k for k in differences(own, wanted) if k not in CHANGEABLE]
        if strange:
            raise InputError(
                f"{run.path}: is a run of another scenario, {own.name}: {strange[0]} differs"
            )
    with readable(runs[0].checkpoint_path):
        trainer.load_state_dict(*saved)
    if trainer.settings.steps < trainer.env_steps:
        raise InputError(
            f"{runs[0].path}: has taken {trainer.env_steps:,} steps already, more than the "
            f"{trainer.settings.steps:,} of training.steps"
        )
    if group.rank == 0:
        for run, wanted in zip(runs, trainer.scenarios, strict=True):
            run.write_scenario(wanted)
            if not trainer.finished:
                (run.path / "result.json").unlink(missing_ok=True)  # of a shorter training
    return trainer


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
    return json.dumps(result, indent=2) + "\n"


@contextmanager
def _stop_signals(*, catch: bool) -> Iterator[list[int]]:
    """While inside, SIGINT and SIGTERM only leave their number in the list, if caught.

    A second signal has its usual effect. Outside the main thread, where no handler may
    be set, the list stays empty.
    """
    received: list[int] = []
    before: dict[signal.Signals, Any] = {}

    def note(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
        received.append(number)
        for name, handler in before.items():
            signal.signal(name, handler)

    try:
        for name in (signal.SIGINT, signal.SIGTERM) if catch else ():
            before[name] = signal.signal(name, note)
    except ValueError:
        pass
    try:
        yield received
    finally:
        for name, handler in before.items():
            signal.signal(name, handler)
