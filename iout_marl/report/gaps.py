"""How far policies are from what none can beat, and from the best that is known."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from iout_marl.bounds import gap_percent
from iout_marl.report.document import Section, Table
from iout_marl.report.figure import Axis, Line, Plot
from iout_marl.report.measures import (
    NO_BREAK,
    bound_text,
    fixed,
    metric,
)
from iout_marl.report.study_figures import axis_of, protocol
from iout_marl.study.results import Measured, Results, measured_of
from iout_marl.words import counted

#: Gaps are drawn on a logarithmic axis; smaller ones are drawn as this, in percent.
LEAST_DRAWN = 0.1
#: Gaps in percent that differ by less are the same: means come from sums of rounded numbers.
ALIKE = 1e-3

WHAT_IT_IS = (
    "A bound is certified: no policy whatsoever has a lower mean AoI in that world. The optimum "
    "lies between it and the best known, the lowest mean AoI that any policy of this study "
    "reaches there. (Where nodes lie elsewhere in every episode, bound and policies are those of "
    "such worlds on average.)"
)


@dataclass(frozen=True)
class Spread:
    """Values of seeds or layouts: their median, the least and the largest."""

    median: float
    least: float
    largest: float

    @classmethod
    def from_values(cls, values: Sequence[float]) -> Spread:
        """The spread of one value or more."""
        return cls(float(np.median(values)), min(values), max(values))

    @property
    def is_range(self) -> bool:
        """Whether there is more than one value."""
        return self.largest - self.least > ALIKE and math.isfinite(self.largest)

    def text(self) -> str:
        """As percent, the range only where there is one."""
        median = f"{_digits(self.median)}{NO_BREAK}%"
        if not self.is_range:
            return median
        return f"{median} ({_digits(self.least)} to {_digits(self.largest)})"


@dataclass(frozen=True)
class Gaps:
    """The gaps of a series at one place.

    Attributes:
        series, place: whose they are.
        runs: how many of its runs are in worlds with a bound.
        mean_aoi: theirs, in slots.
        bound, best_known: of these worlds, on average, in slots.
        above_bound, above_best_known: of each run in its own world, in percent.
    """

    series: str
    place: float
    runs: int
    mean_aoi: Measured
    bound: float
    best_known: float
    above_bound: Spread
    above_best_known: Spread

    @property
    def is_best_known(self) -> bool:
        """Whether one of the runs is the best that is known."""
        return self.above_best_known.least < ALIKE


def best_known(results: Results) -> dict[str, float]:
    """The lowest mean AoI that any policy reaches in each world, by the worlds' hashes."""
    reached: dict[str, float] = {}
    for cell in results.cells:
        if not cell.record.is_bound:
            world = cell.record.world_hash
            reached[world] = min(cell.record.mean("mean_aoi"), reached.get(world, math.inf))
    return reached


def gaps_of(results: Results, bound: str, series: str, place: float) -> Gaps | None:
    """The gaps of a series at a place to a series of bounds; None where it has none."""
    bounds = {r.world_hash: r.mean("mean_aoi") for r in results.records(bound)}
    records = [r for r in results.records(series, place) if r.world_hash in bounds]
    measured = measured_of(records, "mean_aoi")
    if measured is None:
        return None
    reached = best_known(results)
    means, worlds = [r.mean("mean_aoi") for r in records], [r.world_hash for r in records]
    return Gaps(
        series,
        place,
        len(records),
        measured,
        float(np.mean([bounds[world] for world in worlds])),
        float(np.mean([reached[world] for world in worlds])),
        Spread.from_values([_gap(m, bounds[w]) for m, w in zip(means, worlds, strict=True)]),
        Spread.from_values([_gap(m, reached[w]) for m, w in zip(means, worlds, strict=True)]),
    )


def gap_section(results: Results, *, grouped: bool = False) -> Section:
    """A figure and a table for each series of bounds; nothing where there is none.

    Args:
        results: of the study.
        grouped: as for `metric_figure`.
    """
    items: list[Plot | Table] = []
    for number, (bound, found) in enumerate(_by_bound(results), start=1):
        items += [
            _figure(results, f"gap-{number}", bound, found, grouped=grouped),
            _table(results, f"gap-table-{number}", bound, found),
        ]
    return Section("gap", "The gap to the optimum", paragraphs=(WHAT_IT_IS,), items=tuple(items))


def gap_lead(results: Results) -> list[str]:
    """How close the trained policies get, a sentence for each series of them and of bounds."""
    by_series: dict[str, list[tuple[str, list[Gaps]]]] = {}
    for bound, found in _by_bound(results):
        for name in dict.fromkeys(gaps.series for gaps in found):
            own = [gaps for gaps in found if gaps.series == name]
            trained = any(record.training for record in results.records(name))
            if trained and len(own) == len(results.places(name)):
                by_series.setdefault(name, []).append((bound, own))
    return [
        f"{name}: {_extent([g.above_bound.median for g in own])} above the "
        f"{bound if len(bounds) > 1 else 'certified bound'}, "
        f"{_extent([g.above_best_known.median for g in own])} above the best known."
        for name, bounds in by_series.items()
        for bound, own in bounds
    ]


def _extent(values: Sequence[float]) -> str:
    ends = list(dict.fromkeys(map(_digits, (min(values), max(values)))))
    return f"{' to '.join(ends)}{NO_BREAK}%"


def _by_bound(results: Results) -> Iterator[tuple[str, list[Gaps]]]:
    """For every series of bounds, the gaps of all series in its worlds, place by place."""
    for bound in filter(results.is_bound, results.series):
        found = [
            gaps
            for place in results.places()
            for name in results.series
            if not results.is_bound(name) and (gaps := gaps_of(results, bound, name, place))
        ]
        if found:
            yield bound, found


def _figure(
    results: Results, key: str, bound: str, found: Sequence[Gaps], *, grouped: bool
) -> Plot:
    lines = []
    for name in dict.fromkeys(gaps.series for gaps in found):
        own = [gaps for gaps in found if gaps.series == name]
        spreads = [gaps.above_bound for gaps in own]
        lines.append(
            Line(
                name,
                tuple(gaps.place for gaps in own),
                tuple(_at_least_drawn(s.median) for s in spreads),
                tuple(_at_least_drawn(s.least if s.is_range else math.nan) for s in spreads),
                tuple(_at_least_drawn(s.largest if s.is_range else math.nan) for s in spreads),
            )
        )
    drawn = [g.above_bound for g in found if math.isfinite(g.above_bound.largest)]
    least = min((spread.least for spread in drawn), default=0.0)
    largest = max((spread.largest for spread in drawn), default=0.0)
    runs = protocol(results, [line.name for line in lines], intervals=False)
    return Plot(
        key=key,
        title=f"Above the {bound}",
        caption=(
            f"Mean AoI above the certified bound, median and range of runs; below {LEAST_DRAWN:g} "
            f"% drawn as {LEAST_DRAWN:g} %. {runs}"
        ),
        command=results.command,
        x=axis_of(results, lines, grouped=grouped),
        y=Axis(
            "Above the bound in %",
            scale="log",
            # A little further than anything is drawn: ends of ranges are seen.
            limits=(LEAST_DRAWN / 1.5, 1.5 * largest) if least < LEAST_DRAWN < largest else None,
        ),
        lines=tuple(lines),
    )


def _at_least_drawn(percent: float) -> float:
    return percent if math.isnan(percent) else max(percent, LEAST_DRAWN)


def _table(results: Results, key: str, bound: str, found: Sequence[Gaps]) -> Table:
    rows = [
        (
            gaps.series,
            results.place_text(gaps.place),
            metric(gaps.mean_aoi, "mean_aoi"),
            bound_text(gaps.bound, 3),
            fixed(gaps.best_known, 3),
            gaps.above_bound.text(),
            gaps.above_best_known.text(),
        )
        for gaps in found
    ]
    series = list(dict.fromkeys(gaps.series for gaps in found))
    without = sum(len(results.records(gaps.series, gaps.place)) - gaps.runs for gaps in found)
    return Table(
        key=key,
        title=f"Mean AoI and the {bound}",
        caption=(
            "Gaps are medians of runs, in brackets the least and the largest. Of several layouts, "
            "bound and best known are means over them. Marked: whose policy is the best known, of "
            f"several layouts in one of them at least. {protocol(results, series, intervals=False)}"
        )
        + (f" Left out: {counted(without, 'run')} in worlds without a bound." if without else ""),
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
        marked=frozenset((row, 4) for row, gaps in enumerate(found) if gaps.is_best_known),
    )


def _digits(percent: float) -> str:
    return fixed(percent, 0 if abs(percent) >= 10 else 1)


def _gap(mean_aoi: float, of: float) -> float:
    """As `gap_percent`; above 0 a gap in percent is none, unless both are 0."""
    if of == 0:
        return 0.0 if mean_aoi == 0 else math.nan
    return gap_percent(mean_aoi, of)
