"""The lines of a plot, laid out alike for the static and the interactive drawing."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import groupby, pairwise

from iout_marl.report import palette
from iout_marl.report.content import Line, Plot

_BAND_FROM = 13  # points from which intervals are a band, not bars
_MOST_TICKS = 24
_NO_DATA = (1.0, 10.0)  # a logarithmic axis without any


@dataclass(frozen=True)
class Series:
    """A line as it is drawn. NaN stands for what cannot be drawn or is not known.

    Attributes:
        colour: `#rrggbb`.
        mark: index into `palette.MARKS`.
        x: places on the axis; for categories 0, 1, 2 ..., a little beside one another.
        y, low, high: values; on a logarithmic axis, intervals end at its smallest value.
        band: intervals are drawn as a band, else as error bars.
        width: of a bar, in units of the axis.
    """

    line: Line
    colour: str
    mark: int
    x: tuple[float, ...]
    y: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    band: bool
    width: float

    def spans(self) -> list[list[int]]:
        """Runs of points that have an interval each."""
        known = groupby(range(len(self.y)), lambda i: not math.isnan(self.low[i]))
        return [list(run) for is_known, run in known if is_known]


def lay_out(plot: Plot) -> list[Series]:
    """The lines of a plot, in their order."""
    places = {x: float(i) for i, x in enumerate(categories(plot))}
    smallest = smallest_value(plot)
    count = len(plot.lines)
    bars = plot.kind == "bars"
    if bars:
        step = 0.8 * _smallest_distance(plot) / max(count, 1)
    else:
        step = min(0.06, 0.24 / max(count, 1)) if plot.categories else 0.0
    laid_out = []
    for i, line in enumerate(plot.lines):
        index = i if line.colour is None else line.colour
        aside = (i - (count - 1) / 2) * step
        low = tuple(map(float, line.low)) or (math.nan,) * len(line.y)
        high = tuple(map(float, line.high)) or (math.nan,) * len(line.y)
        y = tuple(map(float, line.y))
        if plot.log_y:
            y = tuple(value if value > 0 else math.nan for value in y)
            low = tuple(max(value, smallest) if value == value else value for value in low)
            high = tuple(max(value, smallest) if value == value else value for value in high)
        known = [not math.isnan(a + b + c) for a, b, c in zip(low, high, y, strict=True)]
        laid_out.append(
            Series(
                line=line,
                colour=palette.colour(index),
                mark=index % len(palette.MARKS),
                x=tuple(places.get(x, float(x)) + aside for x in line.x),
                y=y,
                low=tuple(a if k else math.nan for a, k in zip(low, known, strict=True)),
                high=tuple(a if k else math.nan for a, k in zip(high, known, strict=True)),
                band=not bars and not plot.categories and line.joined and len(line.x) >= _BAND_FROM,
                width=0.92 * step,
            )
        )
    return laid_out


def categories(plot: Plot) -> list[float]:
    """The values that are categories, ascending; none where x is a continuous axis."""
    return sorted({x for line in plot.lines for x in line.x}) if plot.categories else []


def ticks(plot: Plot) -> tuple[list[float], list[str]]:
    """Places and labels of the categories; if there are very many, of every so many."""
    labels = [f"{x:g}" for x in categories(plot)]
    every = -(-len(labels) // _MOST_TICKS) or 1
    return [float(i) for i in range(0, len(labels), every)], labels[::every]


def smallest_value(plot: Plot) -> float:
    """The smallest value above 0 of y and its intervals; 1 if there is none."""
    values = (value for line in plot.lines for part in (line.y, line.low) for value in part)
    return min((value for value in values if value > 0), default=1.0)


def x_limits(plot: Plot) -> tuple[float, float] | None:
    """Limits of the x axis; None where they are left to the data."""
    if plot.categories:
        return -0.6, len(categories(plot)) - 0.4
    if plot.x_range is not None or not plot.log_x:
        return plot.x_range
    points = (point for line in plot.lines for point in zip(line.x, line.y, strict=True))
    is_drawn = (x > 0 and (y > 0 if plot.log_y else not math.isnan(y)) for x, y in points)
    return None if any(is_drawn) else _NO_DATA


def y_limits(plot: Plot) -> tuple[float, float] | None:
    """Limits of the y axis; None where they are left to the data.

    A bar on a logarithmic axis has no natural foot: it stands on the power of ten below
    the smallest value.
    """
    if plot.y_range is not None or not plot.log_y:
        return plot.y_range
    parts = [part for line in plot.lines for part in (line.y, line.high)]
    highest = max((value for part in parts for value in part if value > 0), default=None)
    if highest is None:
        return _NO_DATA
    if plot.kind == "bars":
        return 10.0 ** (math.ceil(math.log10(smallest_value(plot))) - 1), 1.5 * highest
    return None


def _smallest_distance(plot: Plot) -> float:
    if plot.categories:
        return 1.0
    places = sorted({x for line in plot.lines for x in line.x})
    return min((b - a for a, b in pairwise(places)), default=1.0)
