"""The tables of evaluations."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

from rich.table import Table
from rich.text import Text

from iout_marl.breakdown import AUV_COLUMNS, NODE_COLUMNS, STORE_COLUMNS, VEHICLE_COLUMNS
from iout_marl.errors import printable
from iout_marl.evaluation import Evaluation
from iout_marl.metrics import Metric, described
from iout_marl.outlook import energy_outlook
from iout_marl.scenario import Scenario
from iout_marl.terminal import complain, present
from iout_marl.words import counted, listed

#: Policies that a table has a column for each of; of more it tells the spread.
SIDE_BY_SIDE = 4
#: Who plays where, of several runs whose layouts were drawn for each.
EACH_ITS_OWN = "each in a layout of its own"


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
    metrics = _rows(results)
    headings = [printable(metric.heading) for metric in metrics]
    rows = [[_cell(result, metric) for result in results] for metric in metrics]
    if several_layouts:
        rows.insert(0, [result.scenario_hash for result in results])
    table = Table()
    table.add_column("", min_width=max(map(len, headings)))
    for result, cells in zip(results, zip(*rows, strict=True), strict=True):
        # Only the heading may be folded.
        width = max(map(len, cells))
        heading = Text(printable(result.label))
        table.add_column(heading, justify="right", overflow="fold", min_width=width)
    for row_heading, row in zip(["layout"] * several_layouts + headings, rows, strict=True):
        table.add_row(Text(row_heading), *row)
    present(table)


def show_breakdown(result: Evaluation) -> None:
    """A row for each node, and for each AUV, if they were told apart.

    What only stores with limits and batteries have stands in tables of their own: with all columns
    side by side a table would be wider than most terminals.
    """
    if result.breakdown is None:
        return
    breakdown, means = result.breakdown, "; means over episodes" * (result.episodes > 1)
    present(f"{printable(result.label)}: a slot is {breakdown.slot_s:g} s{means}")
    for what, group, found in (
        ("node", NODE_COLUMNS, breakdown.nodes),
        ("node", STORE_COLUMNS, breakdown.nodes),
        ("AUV", AUV_COLUMNS, breakdown.auvs),
        ("AUV", VEHICLE_COLUMNS, breakdown.auvs),
    ):
        columns = [column for column in group if column.name in found]
        if not columns:
            continue
        table = Table(padding=(0, 0, 0, 1))
        for heading in (what, *(column.heading for column in columns)):
            # A heading is folded between its words.
            table.add_column(heading, justify="right", min_width=max(map(len, heading.split())))
        rows = zip(*(found[column.name].mean(axis=0).tolist() for column in columns), strict=True)
        for number, row in enumerate(rows, start=1):
            cells = (f"{v:.{column.digits}f}" for v, column in zip(row, columns, strict=True))
            table.add_row(str(number), *cells)
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
    for metric in _rows(results):
        means = [result.metrics[metric.name].mean for result in results]
        figures = (min(means), statistics.median(means), max(means))
        row_heading = Text(printable(metric.heading))
        table.add_row(row_heading, *(f"{figure:.{metric.digits}f}" for figure in figures))
    present(table)


def _rows(results: Sequence[Evaluation]) -> list[Metric]:
    """The metrics that a table has a row for."""
    return [metric for metric in map(described, results[0].samples) if metric.in_table]


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


def _cell(result: Evaluation, metric: Metric) -> str:
    estimate = result.metrics[metric.name]
    spread = f" ± {estimate.margin:.{metric.digits}f}" if result.episodes > 1 else ""
    return f"{estimate.mean:.{metric.digits}f}{spread}"


def say_outlook(scenario: Scenario) -> None:
    """Beside results, on standard error: what is refused is answered by one line alone."""
    if outlook := energy_outlook(scenario):
        complain(f"note: {outlook}")
