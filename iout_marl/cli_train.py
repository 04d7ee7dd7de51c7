"""The command that trains."""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from iout_marl.cli_options import (
    Imports,
    Overrides,
    ScenarioArgument,
    folder,
    take,
    whole,
)
from iout_marl.cli_tables import SIDE_BY_SIDE, say_outlook, show_columns, show_spread
from iout_marl.errors import InputError
from iout_marl.outside import import_words
from iout_marl.scenario import Scenario, load_scenario
from iout_marl.scenario.keys import all_keys
from iout_marl.scenario.loading import where_written
from iout_marl.terminal import (
    imports_uninterrupted,
    present,
)
from iout_marl.whole import MAX_SEED

if TYPE_CHECKING:
    from trainers import TrainingOutcome

#: What part of a mean AoI is much.
MUCH = 0.25


def train(
    scenario: ScenarioArgument,
    out: Annotated[
        Path | None,
        typer.Option(metavar="RUN", parser=folder, help="Folder of the run [runs/SCENARIO-sSEED]."),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            parser=whole(0, MAX_SEED),
            help="Seed of weights, layouts and actions [0].",
        ),
    ] = None,
    steps: Annotated[
        int | None,
        typer.Option(
            metavar="N", parser=whole(1, 2**63 - 1), help="Environment steps [the scenario's]."
        ),
    ] = None,
    device: Annotated[str, typer.Option(help="auto, cpu or cuda.")] = "auto",
    resume: Annotated[
        Path | None,
        typer.Option(metavar="RUN", parser=folder, help="Continue with a run that was stopped."),
    ] = None,
    threads: Annotated[
        int | None,
        typer.Option(metavar="N", parser=whole(1, 1024), help="Threads of torch on a CPU [1]."),
    ] = None,
    replicas: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            parser=whole(1, 10_000),
            help="Policies side by side, from seeds SEED, SEED + 1, … [1].",
        ),
    ] = None,
    start: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="START",
            help="Begin with the weights of: pretrained, or a RUN whose network is a set.",
        ),
    ] = None,
    overrides: Overrides = None,
    imports: Imports = None,
    *,
    graphs: Annotated[
        bool,
        typer.Option(
            "--graphs/--no-graphs", help="On a CUDA device, record the work and replay it."
        ),
    ] = True,
) -> None:
    """Train a policy by PPO. Ctrl-C saves, as do SIGTERM and SIGHUP; --resume continues.

    Several processes train one policy by `torchrun --nproc-per-node N -m trainers.ppo SCENARIO …`.
    """
    take(imports)
    settings = list(overrides or [])
    if steps is not None:
        settings.append(f"training.steps={steps}")
    if start is None:
        loaded = load_scenario(scenario, settings)
    if resume is not None and out is not None and out != resume:
        raise InputError("--out and --resume name different folders; --resume continues in its own")
    if resume is not None and seed is not None:
        raise InputError("--seed: a resumed run continues with its own seed")
    if resume is not None and replicas is not None:
        raise InputError("--replicas: a resumed training continues with the policies that it has")
    seed, replicas = seed or 0, replicas or 1
    if seed + replicas - 1 > MAX_SEED:
        raise InputError(f"--replicas {replicas}: the last seed would be above {MAX_SEED}")

    with imports_uninterrupted():
        import torch

        import trainers
        from trainers.starting import started_from

    if start is not None:
        loaded, _ = started_from(start, scenario, settings)
    # More threads than one gain little on networks of this size, and cost much on busy cores.
    torch.set_num_threads(threads or 1)
    name = re.sub(r"[^\w.-]+", "-", loaded.name)
    seeds = f"s{seed}" if replicas == 1 else f"s{seed}-{seed + replicas - 1}"
    folder = resume or out or Path("runs") / f"{name}-{seeds}"
    with (
        _with_place(scenario, settings),
        trainers.started_group(trainers.find_device(device)) as (group, own_device),
    ):
        outcome = trainers.train(
            # Its preset gives way to that of fine-tuning where the file itself says nothing.
            loaded if start is None else scenario,
            folder,
            seed,
            own_device,
            resume=resume is not None,
            replicas=replicas,
            group=group,
            use_graphs=graphs,
            overrides=None if start is None else settings,
            start=start,
        )
    if group.rank == 0:
        say_outlook(loaded)
        _report(outcome, folder, scenario, settings, start=start, graphs=graphs)
    if outcome.signal is not None:
        raise typer.Exit(128 + outcome.signal)


@contextmanager
def _with_place(scenario: str, settings: list[str]) -> Iterator[None]:
    """Say of settings that the training alone can check where they are written."""
    try:
        yield
    except InputError as error:
        key = re.match(r"training\.\w+", str(error))
        if key is None or key[0] not in all_keys(Scenario):
            raise
        raise InputError(f"{where_written(scenario, settings, key[0])}: {error}") from None


def _report(
    outcome: TrainingOutcome,
    run: Path,
    scenario: str,
    settings: list[str],
    *,
    start: str | None,
    graphs: bool,
) -> None:
    if not outcome.finished:
        words = ["iout", "train", scenario, "--resume", str(run), *import_words()]
        words += ["--from", start] if start else []
        words += [] if graphs else ["--no-graphs"]
        words += [word for setting in settings for word in ("--set", setting)]
        # The status says that it was stopped, even where nobody can be told so.
        with suppress(OSError):
            present(
                f"stopped after {outcome.trainer.env_steps:,} environment steps; "
                f"continue with: {shlex.join(words)}"
            )
        return
    present("evaluation by most probable actions:")
    if len(outcome.evaluations) > SIDE_BY_SIDE:
        show_spread(outcome.evaluations)
    else:
        show_columns(outcome.evaluations)
    for note in _notes(outcome, scenario, settings):
        present(note)
    folder = shlex.quote(str(run))
    took = f"{outcome.seconds:.1f}" if outcome.seconds < 10 else f"{outcome.seconds:.0f}"
    done = "trained before" if outcome.was_complete else f"trained for {took} s"
    present(f"{done}; the run is in {folder} (curves: tensorboard --logdir {folder})")


def _notes(outcome: TrainingOutcome, scenario: str, settings: list[str]) -> list[str]:
    """Where a policy's sampled actions and its most probable ones differ much: what to do."""
    notes = []
    for run, evaluation, sampled in zip(
        outcome.runs, outcome.evaluations, outcome.sampled_aoi, strict=True
    ):
        probable = evaluation.metrics["mean_aoi"]
        if sampled is None:
            continue
        difference = abs(probable.mean - sampled)
        margin = 0.0 if math.isnan(probable.margin) else probable.margin
        if difference > max(MUCH * min(sampled, probable.mean), margin):
            words = ["iout", "evaluate", scenario, "--policy", str(run.path), "--sampled"]
            words += import_words()
            words += [word for setting in settings for word in ("--set", setting)]
            notes.append(
                f"note: mean AoI was {sampled:.2f} with sampled actions at the end of the "
                f"training, and is {probable.mean:.2f} with the most probable ones, which can go "
                f"in circles; see: {shlex.join(words)}"
            )
    # Of many policies alike, one tells enough.
    if len(notes) > 1:
        notes[1:] = [f"note: the same holds of {len(notes) - 1} more"]
    return notes
