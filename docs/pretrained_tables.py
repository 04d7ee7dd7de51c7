"""The tables of `pretrained.md`, from the committed results of the study `pretrained`."""

from __future__ import annotations

from collections.abc import Sequence

from committed import results_of
from markdown_tables import table

from iout_marl.bounds import rounded_down
from iout_marl.report.measures import has_interval
from iout_marl.study.results import Results

MODES = ("FDD", "TDD")


def results() -> Results:
    """The committed results."""
    return results_of("pretrained")


def _aoi(series: str, place: float) -> str:
    """Mean AoI and half of its 95 % interval, where it has one; a bound is rounded down."""
    measured = results().measured(series, place, "mean_aoi")
    if measured is None:
        return "–"
    if results().is_bound(series):
        return rounded_down(measured.mean, 3)
    found = measured.estimate
    if not has_interval(found):
        return f"{found.mean:.2f}"
    # Short, for columns as narrow as these.
    return f"{found.mean:.2f}\N{NO-BREAK SPACE}± {(found.high - found.low) / 2:.2f}"


def _by_size(rows: Sequence[tuple[str, str]], like: str) -> str:
    """A row for each series, which has a name of its own, and a column for each number of nodes."""
    places = results().places(like)
    headings = ("mean AoI", *(f"K = {place:g}" for place in places))
    return table(
        headings, [(name, *(_aoi(series, place) for place in places)) for name, series in rows]
    )


def unseen_table() -> str:
    """Layouts that no training has drawn, up to a hundred nodes."""
    rows = [
        (f"{mode}, {name}", f"{name}, unseen, {mode}")
        for mode in MODES
        for name in ("pretrained", "greedy")
    ]
    rows.append(("scheduling bound", "bound, unseen, FDD"))
    return _by_size(rows, "pretrained, unseen, FDD")


def elsewhere_table() -> str:
    """Other grids and horizons."""
    where = ("6 × 6 × 2 cells", "20 × 20 × 6 cells", "60 slots", "200 slots")
    rows = [
        (
            each,
            *(_aoi(f"{n}, {each}, {mode}", 10) for mode in MODES for n in ("pretrained", "greedy")),
            _aoi(f"bound, {each}, FDD", 10),
        )
        for each in where
    ]
    played = (f"{mode}, {name}" for mode in MODES for name in ("pretrained", "greedy"))
    return table(("mean AoI, K = 10", *played, "scheduling bound"), rows)


def layouts_table() -> str:
    """The twenty layouts of `random/`, beside all that was made for each alone."""
    rows = [
        (f"{mode}, {name}", f"{name}, twenty layouts, {mode}")
        for mode in MODES
        for name in ("pretrained", "tour", "planner", "bound")
    ]
    for at, mode in ((3, "FDD"), (8, "TDD")):
        rows.insert(at, (f"{mode}, PPO, ten layouts", f"PPO for the layout alone, {mode}"))
    return _by_size(rows, "pretrained, twenty layouts, FDD")


def teams_table() -> str:
    """Teams in FDD, beside the scheduling bound."""
    teams = [(f"{m} AUVs, FDD", k) for m in (2, 3, 4) for k in (10, 20, 50)]
    teams.append(("8 AUVs, 20 × 20 × 6 cells, FDD", 100))
    names = ("pretrained", "tour", "greedy", "bound")
    rows = [
        (
            team.removesuffix(", FDD"),
            str(nodes),
            *(_aoi(f"{name}, {team}", nodes) for name in names),
        )
        for team, nodes in teams
    ]
    return table(("mean AoI", "K", *names[:3], "scheduling bound"), rows)
