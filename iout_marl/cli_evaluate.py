"""The command that runs policies."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from iout_marl.cli_options import (
    POLICY,
    Imports,
    JsonFile,
    Overrides,
    ScenarioArgument,
    expanded,
    give_out,
    json_target,
    refuse_same_file,
    take,
    whole,
)
from iout_marl.cli_policies import Ahead, evaluate_all, keep_inputs, planner_budget
from iout_marl.cli_tables import say_outlook, show_breakdown, show_columns
from iout_marl.evaluation import MAX_EPISODES
from iout_marl.policies import BASELINES, DEFAULT_BUDGET, POLICIES
from iout_marl.scenario import load_scenario
from iout_marl.whole import MAX_SEED


def evaluate(
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
            parser=json_target,
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
    beam: Annotated[
        int | None,
        typer.Option(
            "--beam",
            metavar="N",
            parser=whole(1, 10_000),
            help="Trained policies guide a beam search that keeps N episodes in every slot, and "
            "then play the best.",
        ),
    ] = None,
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
        ahead=Ahead(best_of, mirrored, beam),
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
