"""How far policies are from what none can beat, and from the best that is known."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from iout_marl.report.content import Line, Plot, Section, Table
from iout_marl.report.measures import NO_BREAK, metric, place_text
from iout_marl.report.study_figures import protocol
from iout_marl.study.results import Record, Results
from iout_marl.study.schema import BOUND

#: Gaps are drawn on a logarithmic axis; smaller ones are drawn as this, in percent.
LEAST_DRAWN = 0.1

WHAT_IT_IS = (
    "A bound is certified: no policy whatsoever has a lower mean AoI in that world. The optimum "
    "lies between it and the best known, the lowest mean AoI that any policy of this study "
    "reaches there."
)


@dataclass(frozen=True)
class World:
    """What is known of a world.

    Attributes:
        bound: no policy's mean AoI is below it, in slots.
        best_known: the lowest mean AoI that any series of the study reaches.
        by: that series.
    """

    bound: float
    best_known: float
    by: str


@dataclass(frozen=True)
class Spread:
    """Values of seeds or layouts: their median, the least and the largest."""

    median: float
    least: float
    largest: float

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread:
        """Of one value or more."""
        return cls(float(np.median(values)), min(values), max(values))

    @property
    def is_range(self) -> bool:
        """Whether there is more than one value."""
        return self.least < self.largest

    def text(self) -> str:
        """As percent, the range only where there is one."""
        median = f"{_digits(self.median)}{NO_BREAK}%"
        if not self.is_range:
            return median
        return f"{median} ({_digits(self.least)} to {_digits(self.largest)})"


@dataclass(frozen=True)
class Gaps:
    """The gaps of a series at one place, in percent."""

    series: str
    place: float
    above_bound: Spread
    above_best_known: Spread


def known_worlds(results: Results) -> dict[str, World]:
    """The worlds that have a bound and a policy, by their hashes."""
    bounds: dict[str, float] = {}
    reached: dict[str, tuple[float, str]] = {}
    for cell in results.cells:
        world, mean_aoi = cell.record.world_hash, cell.record.mean("mean_aoi")
        if cell.record.policy == BOUND:
            bounds[world] = max(mean_aoi, bounds.get(world, 0.0))
        elif world not in reached or mean_aoi < reached[world][0]:
            reached[world] = mean_aoi, cell.series
    return {w: World(bounds[w], *reached[w]) for w in bounds if w in reached}


def gaps_of(results: Results, worlds: dict[str, World], name: str, place: float) -> Gaps | None:
    """The gaps of a series at a place; None where it has no bound."""
    pairs = [(r, worlds[r.world_hash]) for r in results.records(name, place) if _is_in(r, worlds)]
    if not pairs:
        return None
    return Gaps(
        name,
        place,
        Spread.of([_percent(r.mean("mean_aoi"), world.bound) for r, world in pairs]),
        Spread.of([_percent(r.mean("mean_aoi"), world.best_known) for r, world in pairs]),
    )


def gap_section(results: Results) -> Section:
    """A figure and a table for each series of bounds; nothing where there is none."""
    worlds = known_worlds(results)
    items: list[Plot | Table] = []
    for number, (bound, found) in enumerate(_by_bound(results, worlds), start=1):
        items += [
            _figure(results, f"gap-{number}", bound, found),
            _table(results, f"gap-table-{number}", bound, found, worlds),
        ]
    return Section(
        "gap",
        "The gap to the optimum",
        paragraphs=(WHAT_IT_IS,),
        items=tuple(items),
    )


def gap_lead(results: Results) -> list[str]:
    """How near the trained policies come, a sentence for each series with bounds."""
    sentences = []
    for _, found in _by_bound(results, known_worlds(results)):
        trained = {g.series for g in found if any(r.training for r in results.records(g.series))}
        for name in (n for n in results.series if n in trained):
            own = [g for g in found if g.series == name]
            if len(own) < len(results.places(name)):
                continue
            sentences.append(
                f"{name}: {_extent([g.above_bound.median for g in own])} above the certified "
                f"bound, {_extent([g.above_best_known.median for g in own])} above the best known."
            )
    return sentences


def _extent(values: Sequence[float]) -> str:
    ends = list(dict.fromkeys(map(_digits, (min(values), max(values)))))
    return f"{' to '.join(ends)}{NO_BREAK}%"


def _by_bound(results: Results, worlds: dict[str, World]) -> Iterator[tuple[str, list[Gaps]]]:
    """For every series of bounds, the gaps of all series in its worlds, place by place."""
    for bound in results.series:
        records = results.records(bound)
        if records[0].policy != BOUND:
            continue
        own = {r.world_hash: worlds[r.world_hash] for r in records if _is_in(r, worlds)}
        found = [
            gaps
            for place in results.places()
            for name in results.series
            if not any(r.policy == BOUND for r in results.records(name))
            if (gaps := gaps_of(results, own, name, place))
        ]
        if found:
            yield bound, found


def _figure(results: Results, key: str, bound: str, found: Sequence[Gaps]) -> Plot:
    lines = []
    for colour, name in enumerate(dict.fromkeys(gaps.series for gaps in found)):
        own = [gaps for gaps in found if gaps.series == name]
        spreads = [gaps.above_bound for gaps in own]
        lines.append(
            Line(
                name,
                tuple(gaps.place for gaps in own),
                tuple(max(s.median, LEAST_DRAWN) for s in spreads),
                tuple(max(s.least, LEAST_DRAWN) if s.is_range else math.nan for s in spreads),
                tuple(max(s.largest, LEAST_DRAWN) if s.is_range else math.nan for s in spreads),
                colour=colour,
            )
        )
    return Plot(
        key=key,
        title=f"Above the {bound}",
        caption=(
            f"Mean AoI above the certified bound, median and range of runs; below {LEAST_DRAWN:g} "
            f"% drawn as {LEAST_DRAWN:g} %. {protocol(results, [line.name for line in lines])}"
        ),
        command=results.command,
        x_label=results.axis.label,
        y_label="Above the bound in %",
        lines=tuple(lines),
        kind="bars",
        log_y=True,
        categories=True,
    )


def _table(
    results: Results, key: str, bound: str, found: Sequence[Gaps], worlds: dict[str, World]
) -> Table:
    rows: list[tuple[str, ...]] = []
    marked = set()
    for gaps in found:
        records = results.records(gaps.series, gaps.place)
        here = {r.world_hash: worlds[r.world_hash] for r in records if _is_in(r, worlds)}
        if any(world.by == gaps.series for world in here.values()):
            marked.add((len(rows), 4))
        rows.append(
            (
                gaps.series,
                place_text(gaps.place),
                metric(results.measured(gaps.series, gaps.place, "mean_aoi"), "mean_aoi"),
                f"{np.mean([world.bound for world in here.values()]):.3f}",
                f"{np.mean([world.best_known for world in here.values()]):.3f}",
                gaps.above_bound.text(),
                gaps.above_best_known.text(),
            )
        )
    return Table(
        key=key,
        title=f"Mean AoI and the {bound}",
        caption=(
            "Gaps are medians of runs, in brackets the least and the largest. Of several layouts, "
            "bound and best known are means over them. Marked: whose policy is the best known, of "
            "several layouts in one of them at least. "
            + protocol(results, list(dict.fromkeys(gaps.series for gaps in found)))
        ),
        command=results.command,
        columns=(
            "Series",
            results.axis.label,
            "Mean AoI in slots",
            "Certified bound",
            "Best known",
            "Above the bound",
            "Above the best known",
        ),
        rows=tuple(rows),
        numeric=frozenset(range(1, 7)),
        marked=frozenset(marked),
    )


def _is_in(record: Record, worlds: dict[str, World]) -> bool:
    return record.world_hash in worlds


def _percent(mean_aoi: float, of: float) -> float:
    return 100 * (mean_aoi / of - 1)


def _digits(percent: float) -> str:
    return f"{percent:.0f}" if abs(percent) >= 10 else f"{percent:.1f}"
