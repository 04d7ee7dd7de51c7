"""The command line, `iout`."""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from typing import Annotated, NoReturn

import numpy as np
import typer
from rich.table import Table
from rich.text import Text

from iout_marl import __version__, startup
from iout_marl.cli_bound import bound_command
from iout_marl.cli_errors import notes_in_a_line, reason_of
from iout_marl.cli_export import export
from iout_marl.cli_json_schema import schema
from iout_marl.cli_mission import mission
from iout_marl.cli_new import new
from iout_marl.cli_options import (
    POLICY,
    Imports,
    JsonFile,
    Overrides,
    ScenarioArgument,
    expanded,
    file_ending,
    give_out,
    refuse_same_file,
    take,
    whole,
)
from iout_marl.cli_policies import evaluate_all, keep_inputs, planner_budget
from iout_marl.cli_replay import replay
from iout_marl.cli_scenario import scenario_app
from iout_marl.cli_studies import report, reproduce
from iout_marl.cli_tables import say_outlook, show_breakdown, show_columns
from iout_marl.cli_train import train
from iout_marl.evaluation import MAX_EPISODES
from iout_marl.files import inputs_noted
from iout_marl.outlook import energy_outlook
from iout_marl.policies import BASELINES, DEFAULT_BUDGET, POLICIES
from iout_marl.scenario import bundled_names, load_scenario, to_yaml
from iout_marl.scenario.explanation import explanation
from iout_marl.terminal import (
    complain,
    finish_output,
    prepare_streams,
    present,
)
from iout_marl.whole import MAX_SEED

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="AUVs that charge underwater sensor nodes by sound and collect their data.",
)


def _print_version(value: bool) -> None:  # noqa: FBT001 (Typer calls it so)
    if value:
        present(__version__)
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
    rows = [("scenario", "nodes", "AUVs", "duplex", "reward", "")]
    for name in bundled_names():
        s = load_scenario(name)
        sizes = str(s.num_nodes), str(s.num_auvs)
        rows.append((name, *sizes, s.duplex.kind, s.reward.kind, s.description))
    table = Table(box=None, pad_edge=False)
    for heading, *cells in zip(*rows, strict=True):
        # Only the description, under no heading, is folded where there is little room.
        width = max(map(len, (heading, *cells))) if heading else 20
        is_number = heading in ("nodes", "AUVs")
        table.add_column(heading, justify="right" if is_number else "left", min_width=width)
    for row in rows[1:]:
        table.add_row(*map(Text, row))
    present(table)


@app.command()
def show(
    scenario: ScenarioArgument,
    *,
    explain: Annotated[
        bool,
        typer.Option("--explain", help="Say of every key what it means, with unit and range."),
    ] = False,
    overrides: Overrides = None,
    imports: Imports = None,
) -> None:
    """Print a whole scenario, after `extends`, preset and overrides, as YAML."""
    take(imports)
    loaded = load_scenario(scenario, overrides or [])
    hashes = f"# hash {loaded.hash}, of the world alone {loaded.world_hash}"
    outlook = energy_outlook(loaded)
    notes = f"{hashes}\n# {outlook}" if outlook else hashes
    body = explanation(loaded) if explain else to_yaml(loaded)
    present(f"{notes}\n{body}".rstrip("\n"))


app.command()(train)


@app.command("evaluate")
def evaluate_command(
    scenario: ScenarioArgument,
    policy: Annotated[
        list[str] | None,
        typer.Option(
            metavar=POLICY,
            parser=expanded,
            help=f"{', '.join(POLICIES)} (the last two plan every layout anew, which takes a "
            "moment for each); the folder of a run; or a policy of your own, by MODULE:NAME or "
            f"FILE.py:NAME. May be repeated [default: {', '.join(BASELINES)}].",
        ),
    ] = None,
    episodes: Annotated[
        int,
        typer.Option(
            metavar="N",
            parser=whole(1, MAX_EPISODES),
            help="Episodes of each policy; where neither it nor the world leaves anything to "
            "chance, one is played.",
        ),
    ] = 100,
    seed: Annotated[
        int,
        typer.Option(
            metavar="N",
            parser=whole(0, MAX_SEED),
            help="Seed of layouts and chance; that of the next episode is one more.",
        ),
    ] = 0,
    json_file: JsonFile = None,
    save_episode: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            parser=file_ending(".json"),
            help="Keep the first episode of one policy as JSON, for iout replay --recording.",
        ),
    ] = None,
    *,
    planner_seconds: Annotated[
        float | None,
        typer.Option(help="Time for the planner, of all layouts together; more is better."),
    ] = None,
    planner_rounds: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            parser=whole(0, 10**9),
            help="The same in rounds of its search, which give the same plans on any machine "
            f"[{DEFAULT_BUDGET.rounds}].",
        ),
    ] = None,
    planner_start: Annotated[
        list[str] | None,
        typer.Option(
            metavar=POLICY,
            parser=expanded,
            help="A policy that the planner starts from: it will be no worse; may be repeated.",
        ),
    ] = None,
    sampled: Annotated[
        bool,
        typer.Option(
            "--sampled",
            help="Draw the actions of trained policies, as in training, rather than take the "
            "most probable.",
        ),
    ] = False,
    best_of: Annotated[
        int,
        typer.Option(
            "--best-of",
            metavar="N",
            parser=whole(1, 10_000),
            help="Trained policies play every episode ahead N times, all but once with drawn "
            "actions, and then play the best.",
        ),
    ] = 1,
    mirrored: Annotated[
        bool,
        typer.Option(
            "--mirrored",
            help="Trained policies also play every episode ahead in the mirror images of the "
            "world, and then play the best.",
        ),
    ] = False,
    transfer: Annotated[
        bool,
        typer.Option(
            "--transfer",
            help="Allow runs of another scenario that fits; where each has a layout of its own, "
            "all play in that of the first.",
        ),
    ] = False,
    nodes: Annotated[
        bool,
        typer.Option(
            "--nodes", help="Also a row for each node and each AUV, in slots and seconds."
        ),
    ] = False,
    overrides: Overrides = None,
    imports: Imports = None,
) -> None:
    """Run policies over seeded episodes; means with 95 % confidence intervals."""
    take(imports)
    loaded = load_scenario(scenario, overrides or [])
    refuse_same_file({"--json": json_file, "--save-episode": save_episode})
    for target in (json_file, save_episode):
        keep_inputs(target, [*(policy or []), *(planner_start or [])])
    results, layouts, first_episode = evaluate_all(
        loaded,
        policy or list(BASELINES),
        planner_start or [],
        planner_budget(planner_seconds, planner_rounds),
        episodes,
        seed,
        transfer=transfer,
        sampled=sampled,
        breakdown=nodes,
        best_of=best_of,
        mirrored=mirrored,
        keep_episode=save_episode is not None,
    )
    say_outlook(loaded)
    records = [result.to_json() for result in results]

    def show_tables() -> None:
        show_columns(results, layouts)
        for result in results:
            show_breakdown(result)

    give_out(records[0] if len(records) == 1 else records, json_file, show_tables)
    # After the figures, which a failure here must not cost.
    if first_episode is not None and save_episode is not None:
        first_episode.recording().save(save_episode)


app.command("bound")(bound_command)
app.command()(export)
app.command()(mission)
app.command()(replay)
app.command()(new)
app.add_typer(scenario_app, name="scenario")
app.command()(schema)
app.command()(reproduce)
app.command()(report)


def main(arguments: list[str] | None = None) -> NoReturn:
    """Entry point: exit status 0, or 2 with one clear line for bad input.

    130 after Ctrl-C, and 141, as by SIGPIPE, where nobody reads standard output any more.
    """
    is_program = arguments is None
    status, line = _run(sys.argv[1:] if arguments is None else arguments)
    lost = finish_output()
    if lost is not None and not status:
        status, line = _status_of(lost)
    if line:
        complain(f"iout: {line}")
    if is_program:
        # All is done: from here on Ctrl-C has nothing to interrupt but Python's own end.
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(status)


def _run(arguments: list[str]) -> tuple[int, str]:
    """Run a command line; its exit status, and the line that says what was wrong, if so."""
    try:
        startup.stop_guarding()
        prepare_streams()
        # What is too large to compute with, the results say: a warning would say it elsewhere.
        with np.errstate(all="ignore"), inputs_noted(), notes_in_a_line():
            command = typer.main.get_command(app)
            with command.make_context("iout", list(arguments) or ["--help"]) as context:
                command.invoke(context)
    except typer.Exit as ended:
        return ended.exit_code, ""
    except (KeyboardInterrupt, typer.Abort):
        return 130, "interrupted"
    except Exception as error:
        # What is nobody's input is a fault of this program's: for that, a traceback.
        if reason_of(error) is None:
            raise
        return _status_of(error)
    return 0, ""


def _status_of(error: Exception) -> tuple[int, str]:
    # Whoever reads standard output, `head` say, has seen enough.
    return (141, "") if isinstance(error, BrokenPipeError) else (2, reason_of(error) or "")


if __name__ == "__main__":
    main()
