"""The command that bounds what any policy can reach."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table
from rich.text import Text

from iout_marl.cli_options import (
    POLICY,
    Imports,
    JsonFile,
    Overrides,
    ScenarioArgument,
    expanded,
    give_out,
    take,
    time_s,
    whole,
)
from iout_marl.cli_policies import evaluate_named, keep_inputs, with_layout_of_runs
from iout_marl.evaluation import Evaluation
from iout_marl.scenario import load_scenario
from iout_marl.terminal import present
from iout_marl.whole import MAX_SEED
from iout_marl.words import counted
from iout_marl.world import draws_layout_once, pin_layout

if TYPE_CHECKING:
    from iout_marl.bounds import Bound

#: What is best known without any training.
STRONGEST = ("tour", "planner")
#: Episodes of each policy where nodes are drawn at random; where they are not, one is enough.
RANDOM_EPISODES = 20


def bound_command(
    scenario: ScenarioArgument,
    policy: Annotated[
        list[str] | None,
        typer.Option(
            metavar=POLICY,
            parser=expanded,
            help="A policy to compare with the bound, beside tour and planner; may be repeated.",
        ),
    ] = None,
    seconds: Annotated[
        float,
        typer.Option(
            metavar="S",
            parser=time_s,
            help="Time to search for a higher bound. On top come the policies, some seconds each "
            "that plans, and the check of what was found, mostly some seconds too.",
        ),
    ] = 60.0,
    seed: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            parser=whole(0, MAX_SEED),
            help="Seeds the policies' episodes, and where nodes are drawn once for a run, draws "
            "them as a run of this seed does [0, the bound being for every layout]. A run that is "
            "named as a policy has a layout of its own, which goes before.",
        ),
    ] = None,
    json_file: JsonFile = None,
    overrides: Overrides = None,
    imports: Imports = None,
) -> None:
    """Print a mean AoI that no policy can beat, checked, and how far policies are from it."""
    from iout_marl.bounds import bound
    from iout_marl.world import has_chance

    take(imports)
    names = [*STRONGEST, *(name for name in policy or [] if name not in STRONGEST)]
    asked = load_scenario(scenario, overrides or [])
    keep_inputs(json_file, names)
    loaded = with_layout_of_runs(asked, names, transfer=False)
    # Those of a run come first.
    drawn = f"seed {seed} draws them" if draws_layout_once(loaded) else "the run has drawn them"
    if seed is not None:
        loaded = pin_layout(loaded, seed)
    is_alike = loaded.nodes.part.redraws == "never" and not has_chance(loaded)
    episodes = 1 if is_alike else RANDOM_EPISODES
    played = evaluate_named(loaded, names, episodes, seed or 0, transfer=False)
    reached = {name: found.metrics["mean_aoi"].mean for name, found in played.items()}
    found = bound(loaded, min(reached.values()), seconds)
    if found.energy_and_travel is not None and draws_layout_once(asked):
        layout = f"nodes lie where {drawn}: the one by energy and travel is for this layout alone"
        found = replace(found, validity=f"{found.validity}; {layout}")
    record = found.to_json() | {
        "policies": {
            name: {
                "mean_aoi": mean_aoi,
                "gap_percent": found.gap_percent(mean_aoi),
                "episodes": played[name].episodes,
            }
            for name, mean_aoi in reached.items()
        }
    }
    give_out(record, json_file, lambda: _print(found, reached, _played(played, seed or 0)))


def _print(found: Bound, reached: dict[str, float], played: str) -> None:
    from iout_marl.bounds import percent_text, rounded_down

    present(f"{found.scenario} ({found.scenario_hash}): mean AoI in slots; {found.validity}")
    table = Table()
    table.add_column("")
    table.add_column("mean AoI", justify="right")
    table.add_column("gap", justify="right")
    table.add_row("scheduling bound", rounded_down(found.scheduling, 3), "")
    if found.energy_and_travel is not None:
        is_higher = found.energy_and_travel > found.scheduling
        figure = rounded_down(found.energy_and_travel, 3) if is_higher else "none higher found"
        table.add_row("energy and travel bound", figure, "")
    table.add_section()
    best = min(reached, key=lambda name: reached[name])
    gaps = {name: found.gap_percent(mean_aoi) for name, mean_aoi in reached.items()}
    for name, mean_aoi in reached.items():
        label = f"{name} (best known)" if name == best else name
        table.add_row(Text(label), f"{mean_aoi:.3f}", percent_text(gaps[name]))
    present(table)
    present(f"The higher bound is verified in whole numbers. {played}")
    if below := [name for name, gap in gaps.items() if gap < 0]:
        present(
            f"{', '.join(below)}: below a verified bound, which no policy can be: a fault of this "
            "program, which its authors want to hear of."
        )


def _played(played: dict[str, Evaluation], seed: int) -> str:
    """How many episodes stand behind the figures of the policies."""
    counts = {name: found.episodes for name, found in played.items()}
    of_each = len(set(counts.values())) == 1
    names = {"each policy": counts[STRONGEST[0]]} if of_each else counts
    said = [f"{counted(n, 'episode')} of {name}" for name, n in names.items()]
    return f"Played: {', '.join(said)}, from seed {seed} on."
