"""The command line, `iout`."""

from __future__ import annotations

import json
import math
import re
import shlex
import statistics
import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn, cast

import typer
from rich.console import Console
from rich.table import Table

from iout_marl import __version__
from iout_marl.cli_bound import bound_command
from iout_marl.cli_policies import (
    evaluate_named,
    planner_budget,
    started_planner,
    with_layout_of_runs,
)
from iout_marl.cli_studies import JsonFile, Overrides, ScenarioArgument, report, reproduce
from iout_marl.errors import InputError
from iout_marl.evaluation import Evaluation
from iout_marl.files import write_text
from iout_marl.policies import BASELINES, UNTRAINED, USUAL
from iout_marl.scenario import bundled_names, load_scenario, to_yaml
from iout_marl.terminal import imports_uninterrupted

if TYPE_CHECKING:
    from trainers import TrainingOutcome

#: What Typer raises for a command line that it cannot read.
UsageError = cast("type[Exception]", typer.BadParameter.__base__)
#: Seeds of torch have 64 bits.
MAX_SEED = 2**64 - 1

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="AUVs that charge underwater sensor nodes by sound and collect their data.",
)

#: Policies that a table has a column for each of; of more it tells the spread.
SIDE_BY_SIDE = 4
#: What part of a mean AoI is much.
MUCH = 0.25
#: Rows of the table of an evaluation: metric, heading, decimals.
ROWS = (
    ("mean_aoi", "mean AoI", 2),
    ("final_aoi", "final AoI", 2),
    ("peak_aoi", "peak AoI", 1),
    ("jain", "Jain", 3),
    ("harvested_kj", "harvested kJ", 2),
    ("uplink_success", "uplinks", 3),
    ("reward", "reward", 1),
)


def _print_version(value: bool) -> None:  # noqa: FBT001 (Typer calls it so)
    if value:
        typer.echo(__version__)
        raise typer.Exit


@app.callback()
def _options(
    *,
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Print it."),
    ] = False,
) -> None:
    """Options of every command."""


@app.command()
def scenarios() -> None:
    """List the bundled scenarios."""
    table = Table(box=None, pad_edge=False)
    for heading in ("scenario", "nodes", "AUVs", "duplex", "reward", ""):
        table.add_column(heading, justify="right" if heading in ("nodes", "AUVs") else "left")
    for name in bundled_names():
        s = load_scenario(name)
        table.add_row(
            name, str(s.num_nodes), str(s.num_auvs), s.duplex.kind, s.reward.kind, s.description
        )
    _console().print(table)


@app.command()
def show(scenario: ScenarioArgument, overrides: Overrides = None) -> None:
    """Print a whole scenario, after `extends`, preset and overrides, as YAML."""
    loaded = load_scenario(scenario, overrides or [])
    typer.echo(f"# hash {loaded.hash}, of the world alone {loaded.world_hash}")
    typer.echo(to_yaml(loaded), nl=False)


@app.command()
def train(
    scenario: ScenarioArgument,
    out: Annotated[
        Path | None, typer.Option(metavar="RUN", help="Folder of the run [runs/SCENARIO-sSEED].")
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(min=0, max=MAX_SEED, help="Seed of weights, layouts and actions [0]."),
    ] = None,
    steps: Annotated[
        int | None, typer.Option(min=1, help="Environment steps [the scenario's].")
    ] = None,
    device: Annotated[str, typer.Option(help="auto, cpu or cuda.")] = "auto",
    resume: Annotated[
        Path | None, typer.Option(metavar="RUN", help="Go on with a run that was stopped.")
    ] = None,
    threads: Annotated[
        int | None, typer.Option(min=1, help="Threads of torch on a CPU [1].")
    ] = None,
    replicas: Annotated[
        int | None,
        typer.Option(
            min=1, max=10_000, help="Policies side by side, from seeds SEED, SEED + 1, … [1]."
        ),
    ] = None,
    overrides: Overrides = None,
    *,
    graphs: Annotated[
        bool,
        typer.Option(
            "--graphs/--no-graphs", help="On a CUDA device, record the work and replay it."
        ),
    ] = True,
) -> None:
    """Train a policy by PPO. Ctrl-C saves, as do SIGTERM and SIGHUP; --resume goes on.

    Several processes train one policy by `torchrun --nproc-per-node N -m trainers.ppo SCENARIO …`.
    """
    settings = list(overrides or [])
    if steps is not None:
        settings.append(f"training.steps={steps}")
    loaded = load_scenario(scenario, settings)
    if resume is not None and out is not None and out != resume:
        raise InputError("--out and --resume name different folders; --resume goes on in its own")
    if resume is not None and seed is not None:
        raise InputError("--seed: a resumed run goes on with its own seed")
    if resume is not None and replicas is not None:
        raise InputError("--replicas: a resumed training goes on with the policies that it has")
    seed, replicas = seed or 0, replicas or 1
    if seed + replicas - 1 > MAX_SEED:
        raise InputError(f"--replicas {replicas}: the last seed would be above {MAX_SEED}")

    with imports_uninterrupted():
        import torch

        import trainers

    # More threads than one gain little on networks of this size, and cost much on busy cores.
    torch.set_num_threads(threads or 1)
    name = re.sub(r"[^\w.-]+", "-", loaded.name)
    seeds = f"s{seed}" if replicas == 1 else f"s{seed}-{seed + replicas - 1}"
    folder = resume or out or Path("runs") / f"{name}-{seeds}"
    with trainers.started_group(trainers.find_device(device)) as (group, own_device):
        outcome = trainers.train(
            loaded,
            folder,
            seed,
            own_device,
            resume=resume is not None,
            replicas=replicas,
            group=group,
            use_graphs=graphs,
        )
    if group.rank == 0:
        _report(outcome, folder, scenario, settings, graphs=graphs)
    if outcome.signal is not None:
        raise typer.Exit(128 + outcome.signal)


def _report(
    outcome: TrainingOutcome, run: Path, scenario: str, settings: list[str], *, graphs: bool
) -> None:
    if not outcome.finished:
        words = ["iout", "train", scenario, "--resume", str(run)]
        words += [] if graphs else ["--no-graphs"]
        words += [word for setting in settings for word in ("--set", setting)]
        # The status says that it was stopped, even where nobody can be told so.
        with suppress(OSError):
            typer.echo(
                f"stopped after {outcome.trainer.env_steps:,} environment steps; "
                f"go on with: {shlex.join(words)}"
            )
        return
    typer.echo("evaluation by most probable actions:")
    if len(outcome.evaluations) > SIDE_BY_SIDE:
        _print_spread(outcome.evaluations)
    else:
        _print_table(outcome.evaluations)
    for note in _notes(outcome, scenario, settings):
        typer.echo(note)
    folder = shlex.quote(str(run))
    typer.echo(
        f"trained for {outcome.seconds:.0f} s; the run is in {folder} "
        f"(curves: tensorboard --logdir {folder})"
    )


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


@app.command("evaluate")
def evaluate_command(
    scenario: ScenarioArgument,
    policy: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME|RUN",
            help=f"{', '.join(UNTRAINED)}, or the folder of a run; may be repeated. The last "
            "two plan every layout anew, which takes a moment for each "
            f"[default: {', '.join(BASELINES)}].",
        ),
    ] = None,
    episodes: Annotated[int, typer.Option(min=1, help="Episodes of each policy.")] = 100,
    seed: Annotated[int, typer.Option(min=0, help="Seed of layouts and chance.")] = 0,
    json_file: JsonFile = None,
    *,
    planner_seconds: Annotated[
        float | None,
        typer.Option(help="Time for the planner, of all layouts together; more is better."),
    ] = None,
    planner_rounds: Annotated[
        int | None,
        typer.Option(
            help="The same in rounds of its search, which give the same plans on any machine "
            f"[{USUAL.rounds}]."
        ),
    ] = None,
    planner_start: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME|RUN",
            help="A policy that the planner starts from: it will be no worse; may be repeated.",
        ),
    ] = None,
    transfer: Annotated[
        bool, typer.Option("--transfer", help="Allow runs of another scenario that fits.")
    ] = False,
    overrides: Overrides = None,
) -> None:
    """Run policies over seeded episodes; means with 95 % confidence intervals."""
    loaded = load_scenario(scenario, overrides or [])
    names, starts = policy or list(BASELINES), planner_start or []
    loaded = with_layout_of_runs(loaded, [*names, *starts], transfer=transfer)
    planner = None
    if planner_seconds is not None or planner_rounds is not None or starts:
        if "planner" not in names:
            raise InputError("--planner-…: there is no planner without --policy planner")
        budget = planner_budget(planner_seconds, planner_rounds)
        planner = started_planner(loaded, starts, budget, seed, transfer=transfer)
    results = [
        evaluate_named(loaded, name, episodes, seed, transfer=transfer, planner=planner)
        for name in names
    ]
    records = [r.to_json() for r in results]
    text = json.dumps(records[0] if len(records) == 1 else records, indent=2)
    if json_file is not None and str(json_file) == "-":
        typer.echo(text)
        return
    _print_table(results)
    if json_file is not None:
        write_text(json_file, text)


app.command("bound")(bound_command)
app.command()(reproduce)
app.command()(report)


def _console() -> Console:
    # Piped into a file, a table must not be folded to the width of a terminal.
    return Console(width=None if sys.stdout.isatty() else 160, highlight=False)


def _print_table(results: list[Evaluation]) -> None:
    first = results[0]
    typer.echo(
        f"{first.scenario} ({first.scenario_hash}): {first.episodes} episodes, seed {first.seed}\n"
        "mean ± half of the 95 % confidence interval"
    )
    table = Table()
    # A column for each policy: four of them fit into a terminal of 80 columns.
    table.add_column("")
    for result in results:
        table.add_column(result.policy, justify="right", overflow="fold")
    for name, heading, digits in ROWS:
        cells = []
        for result in results:
            estimate = result.metrics[name]
            cells.append(f"{estimate.mean:.{digits}f}")
            if result.episodes > 1:
                cells[-1] += f" ± {estimate.margin:.{digits}f}"
        table.add_row(heading, *cells)
    _console().print(table)


def _print_spread(results: list[Evaluation]) -> None:
    """What many policies of one training come to."""
    first = results[0]
    typer.echo(
        f"{first.scenario} ({first.scenario_hash}): {len(results)} policies, "
        f"{first.episodes} episodes each, seed {first.seed}\nmeans over their episodes"
    )
    table = Table()
    for heading in ("", "lowest", "median", "highest"):
        table.add_column(heading, justify="right" if heading else "left")
    for name, heading, digits in ROWS:
        means = [result.metrics[name].mean for result in results]
        figures = (min(means), statistics.median(means), max(means))
        table.add_row(heading, *(f"{figure:.{digits}f}" for figure in figures))
    _console().print(table)


def main(arguments: list[str] | None = None) -> NoReturn:
    """Entry point: exit status 0, or 2 with one clear line for bad input."""
    arguments = sys.argv[1:] if arguments is None else arguments
    try:
        status = app(args=arguments or ["--help"], prog_name="iout", standalone_mode=False)
    except InputError as error:
        _fail(str(error))
    except UsageError as error:
        _fail(f"{getattr(error, 'format_message', error.__str__)()} (see: iout --help)")
    except OSError as error:
        _fail(f"{error.filename or 'input or output'}: {error.strerror}")
    except MemoryError:
        _fail("not enough memory")
    except (KeyboardInterrupt, typer.Abort):
        sys.stderr.write("iout: interrupted\n")
        status = 130
    sys.exit(status)


def _fail(message: str) -> NoReturn:
    # In one go: `print` writes line and end apart, and processes of a group may get in between.
    sys.stderr.write(f"iout: {message}\n")
    sys.exit(2)


if __name__ == "__main__":
    main()
