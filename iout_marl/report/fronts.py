"""Mean AoI against fairness: what was reached in each world, and its Pareto front."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from iout_marl.report.document import Section, Table
from iout_marl.report.figure import Axis, Line, Plot
from iout_marl.report.measures import fixed, metric_heading, metric_mean
from iout_marl.report.palette import GREY
from iout_marl.report.study_figures import protocol
from iout_marl.study.results import Record, Results

#: From this Jain's index on, to the digits of tables, (1 − J) · mean AoI is 0.
FAIR = 0.9995

DEGENERATE = (
    "The product (1 − J) · mean AoI is 0 for every policy that serves all nodes equally often, "
    "however old their data are: no bound but 0 holds for it, and there is no gap in percent of 0. "
    "What can be compared is the Pareto front: the least mean AoI for each fairness."
)


@dataclass(frozen=True)
class Point:
    """What a run reaches."""

    series: str
    seed: int
    jain: float
    mean_aoi: float

    @property
    def objective(self) -> float:
        """(1 − J) · mean AoI, in slots."""
        return (1 - self.jain) * self.mean_aoi


def pareto_front(points: Iterable[Point]) -> list[Point]:
    """Those for which no other is as fair and as fresh and better in one; fairest last."""
    front: list[Point] = []
    for point in sorted(points, key=lambda p: (-p.jain, p.mean_aoi)):
        if not front or point.mean_aoi < front[-1].mean_aoi:
            front.append(point)
    return front[::-1]


def front_section(results: Results) -> Section:
    """A figure and a table for each world; nothing where the study does not ask for them."""
    if not results.front:
        return Section("front", "")
    worlds: dict[str, list[tuple[str, Record]]] = {}
    for cell in results.cells:
        if not cell.record.is_bound:
            worlds.setdefault(cell.record.world_hash, []).append((cell.series, cell.record))
    names = Counter(records[0][1].scenario for records in worlds.values())
    items: list[Plot | Table] = []
    sentences = []
    for number, (world, records) in enumerate(worlds.items(), start=1):
        points = [
            Point(series, r.seed, r.mean("jain"), r.mean("mean_aoi")) for series, r in records
        ]
        front = pareto_front(points)
        name = records[0][1].scenario
        if names[name] > 1:
            name = f"{name}, world {world}"
        items += [
            _figure(results, f"front-{number}", name, points, front),
            _table(results, f"front-table-{number}", name, front),
        ]
        sentences.append(_degeneracy(name, points))
    return Section(
        "front",
        "Freshness against fairness",
        paragraphs=(DEGENERATE, *sentences),
        items=tuple(items),
    )


def _degeneracy(world: str, points: Sequence[Point]) -> str:
    """What (1 − J) · mean AoI prefers there, beside what is fresh."""
    freshest = min(points, key=lambda p: p.mean_aoi)
    best = min(points, key=lambda p: p.objective)
    if best == freshest:
        return f"{world}: the least (1 − J) · mean AoI is that of the freshest, {_described(best)}."
    text = (
        f"{world}: the least (1 − J) · mean AoI is that of {_described(best)}; the freshest is "
        f"{_described(freshest)}."
    )
    fair = [p.mean_aoi for p in points if p.jain >= FAIR]
    if len(fair) > 1:
        text += (
            f" {len(fair)} runs have a Jain's index of 1.000; their mean AoI goes from "
            f"{fixed(min(fair), 2)} to {fixed(max(fair), 2)}."
        )
    return text


def _described(point: Point) -> str:
    return (
        f"a run of {point.series} (mean AoI {fixed(point.mean_aoi, 2)}, J {fixed(point.jain, 4)}, "
        f"(1 − J) · mean AoI {fixed(point.objective, 4)})"
    )


def _figure(
    results: Results, key: str, world: str, points: Sequence[Point], front: Sequence[Point]
) -> Plot:
    names = list(dict.fromkeys(point.series for point in points))
    lines = [
        Line(
            "Pareto front",
            tuple(point.jain for point in front),
            tuple(point.mean_aoi for point in front),
            dashed=True,
            colour=GREY,
        )
    ]
    lines += [
        Line(
            name,
            tuple(point.jain for point in points if point.series == name),
            tuple(point.mean_aoi for point in points if point.series == name),
            joined=False,
        )
        for name in names
    ]
    return Plot(
        key=key,
        title=f"Mean AoI against fairness: {world}",
        caption=f"A point is a run; of those on the line none is better in both. "
        f"{protocol(results, names, intervals=False)}",
        command=results.command,
        x=Axis(metric_heading("jain")),
        y=Axis(metric_heading("mean_aoi")),
        lines=tuple(lines),
    )


def _table(results: Results, key: str, world: str, front: Sequence[Point]) -> Table:
    rows = [
        (
            point.series,
            f"{point.seed}",
            fixed(point.jain, 4),
            metric_mean(point.mean_aoi, "mean_aoi"),
            fixed(point.objective, 4),
        )
        for point in front
    ]
    return Table(
        key=key,
        title=f"Pareto front: {world}",
        caption="Of every other run one of these is at least as fair and at least as fresh.",
        command=results.command,
        columns=(
            "Series",
            "Seed",
            metric_heading("jain"),
            metric_heading("mean_aoi"),
            "(1 − J) · mean AoI",
        ),
        rows=tuple(rows),
        numeric=frozenset(range(1, 5)),
    )
