"""The tables of evaluations."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

from rich.table import Table
from rich.text import Text

from iout_marl.errors import printable
from iout_marl.evaluation import Evaluation
from iout_marl.terminal import present
from iout_marl.words import counted, listed

#: Policies that a table has a column for each of; of more it tells the spread.
SIDE_BY_SIDE = 4
#: Who plays where, of several runs whose layouts were drawn for each.
EACH_ITS_OWN = "each in a layout of its own"
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


def show_columns(results: Sequence[Evaluation], layouts: str = EACH_ITS_OWN) -> None:
    """A column for each policy.

    Args:
        results: the evaluations.
        layouts: who plays in which layout, if not all of them in the same.
    """
    several_layouts = len({result.scenario_hash for result in results}) > 1
    has_interval = any(result.episodes > 1 for result in results)
    present(
        f"{_scenario(results, layouts)}{_episodes(results)}"
        + ("\nmean ± half of the 95 % confidence interval" if has_interval else "")
    )
    rows = [[_cell(result, *row) for result in results] for row in ROWS]
    if several_layouts:
        rows.insert(0, [result.scenario_hash for result in results])
    table = Table()
    table.add_column("", min_width=max(len(heading) for _, heading, _ in ROWS))
    for result, cells in zip(results, zip(*rows, strict=True), strict=True):
        # Only the heading may be folded.
        width = max(map(len, cells))
        heading = Text(printable(result.label))
        table.add_column(heading, justify="right", overflow="fold", min_width=width)
    headings = ["layout"] * several_layouts + [heading for _, heading, _ in ROWS]
    for name, row in zip(headings, rows, strict=True):
        table.add_row(name, *row)
    present(table)


def show_spread(results: Sequence[Evaluation]) -> None:
    """What many policies of one training come to."""
    has_several = any(result.episodes > 1 for result in results)
    policies = counted(len(results), "policy", "policies")
    present(
        f"{_scenario(results, EACH_ITS_OWN)}: {policies}, "
        f"{_played(results[0])} each, seed {results[0].seed}"
        + ("\nmeans over their episodes" if has_several else "")
    )
    table = Table()
    for heading in ("", "lowest", "median", "highest"):
        table.add_column(heading, justify="right" if heading else "left")
    for name, heading, digits in ROWS:
        means = [result.metrics[name].mean for result in results]
        figures = (min(means), statistics.median(means), max(means))
        table.add_row(heading, *(f"{figure:.{digits}f}" for figure in figures))
    present(table)


def _scenario(results: Sequence[Evaluation], layouts: str) -> str:
    same = len({result.scenario_hash for result in results}) == 1
    which = f" ({results[0].scenario_hash})" if same else f", {printable(layouts)}"
    return f"{printable(results[0].scenario)}{which}"


def _episodes(results: Sequence[Evaluation]) -> str:
    """How many episodes, of whom if not of all as many, and their seed."""
    seed = f"seed {results[0].seed}"
    groups: dict[str, list[str]] = {}
    for result in results:
        groups.setdefault(_played(result), []).append(printable(result.label))
    if len(groups) == 1:
        return f": {next(iter(groups))}, {seed}"
    whose = "; ".join(f"{played} of {listed(labels)}" for played, labels in groups.items())
    return f", {seed}\n{whose}"


def _played(result: Evaluation) -> str:
    return counted(result.episodes, "episode") + " (deterministic)" * result.deterministic


def _cell(result: Evaluation, name: str, heading: str, digits: int) -> str:  # noqa: ARG001
    estimate = result.metrics[name]
    spread = f" ± {estimate.margin:.{digits}f}" if result.episodes > 1 else ""
    return f"{estimate.mean:.{digits}f}{spread}"
