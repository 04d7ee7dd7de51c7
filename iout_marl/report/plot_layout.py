"""The lines of a plot, laid out alike for the static and the interactive drawing."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable
from dataclasses import dataclass
from itertools import groupby

from rich.cells import cell_len

from iout_marl.report import palette
from iout_marl.report.figure import Line, Plot
from iout_marl.report.markup import plain_text

#: Columns at which a name in a legend and the title of an axis are cut short, and those of a line.
LONGEST_NAME, NAME_LINE = 60, 34
LONGEST_TITLE, TITLE_LINE = 80, 44

_MOST_ENTRIES = 60  # of a legend
_BAND_FROM = 13  # points from which intervals are a band, not bars
_MOST_TICKS = 24
_MOST_LETTERS = 90  # of labels beside one another below an axis
_NO_DATA = (1.0, 10.0)  # a logarithmic axis without any
_LARGEST = 1e60  # beyond which nothing is drawn: sums of squares must be numbers
_SMALLEST = 1e-60


@dataclass(frozen=True)
class Series:
    """A line as it is drawn. NaN stands for what cannot be drawn or is not known.

    Attributes:
        look: colour, mark, dashes, hatching.
        group: lines of one group are shown and hidden together.
        in_legend: whether the legend has an entry for it.
        x: places on the axis; for categories 0, 1, 2 ..., a little beside one another.
        y, low, high: values; on a logarithmic axis, intervals end at its smallest value.
        band: intervals are drawn as a band, else as error bars.
        width: of a bar, of which categories are 1 apart.
    """

    line: Line
    look: palette.Look
    group: str
    in_legend: bool
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
    smallest = smallest_value(plot)
    step = 0.8 / max(len(plot.lines), 1) if plot.x.is_categorical else 0.0
    position = positions(plot)
    bars = _bars(plot)
    entries = legend(plot)
    groups = {name: f"{i}" for i, name in enumerate({line.name: 0 for line in plot.lines})}
    laid_out = []
    for i, line in enumerate(plot.lines):
        unknown = (math.nan,) * len(line.y)
        y, low, high = (tuple(map(_drawn, v)) for v in (line.y, line.low, line.high))
        low, high = low or unknown, high or unknown
        if plot.y.is_log:
            y = tuple(value if value >= _SMALLEST else math.nan for value in y)
            low = tuple(max(value, smallest) if value == value else value for value in low)
            high = tuple(max(value, smallest) if value == value else value for value in high)
        known = [not math.isnan(a + b + c) for a, b, c in zip(low, high, y, strict=True)]
        laid_out.append(
            Series(
                line=line,
                look=palette.look(i if line.colour is None else line.colour, dashed=line.dashed),
                group=groups[line.name],
                in_legend=i in entries,
                x=tuple(position(x) + _aside(bars[x], i) * step for x in line.x),
                y=y,
                low=tuple(a if k else math.nan for a, k in zip(low, known, strict=True)),
                high=tuple(a if k else math.nan for a, k in zip(high, known, strict=True)),
                band=line.joined and len(line.x) >= _BAND_FROM and not plot.x.has_single_values,
                width=0.92 * step,
            )
        )
    return laid_out


def _bars(plot: Plot) -> dict[float, list[int]]:
    """Which lines have a bar at each value of x; bars of the others need no room there."""
    found: dict[float, list[int]] = {x: [] for x in _values(plot)}
    for i, line in enumerate(plot.lines):
        for x in {x for x, y in zip(line.x, line.y, strict=True) if not math.isnan(_drawn(y))}:
            found[x].append(i)
    return found


def _aside(group: list[int], line: int) -> float:
    """How many bars the middle of a line's bar lies right of that of its group."""
    return group.index(line) - (len(group) - 1) / 2 if line in group else 0.0


def name_lines(text: str) -> list[str]:
    """A name as the legend of a page shows it, on so many lines that a phone has room."""
    return _lines(plain_text(text, LONGEST_NAME), NAME_LINE)


def title_lines(text: str) -> list[str]:
    """The title of an axis, on so many lines that the axis is as long."""
    return _lines(plain_text(text, LONGEST_TITLE), TITLE_LINE)


def _lines(text: str, columns: int) -> list[str]:
    # Letters that take two columns each.
    wide = cell_len(text) > 1.5 * len(text)
    return textwrap.wrap(text, columns // 2 if wide else columns) or [""]


def legend(plot: Plot) -> list[int]:
    """Which lines have an entry in the legend: the first of them, if there are very many."""
    return [i for i, line in enumerate(plot.lines) if line.in_legend][:_MOST_ENTRIES]


def is_drawn(value: float) -> bool:
    """Whether a value has a place on a logarithmic axis."""
    return _SMALLEST <= value <= _LARGEST


def _drawn(value: float) -> float:
    return float(value) if abs(value) <= _LARGEST else math.nan


def positions(plot: Plot) -> Callable[[float], float]:
    """Where values of x are drawn: categories at 0, 1, 2, ..., all others at themselves.

    A logarithmic axis with values of 0 or below goes by powers of ten in both directions, the
    value that is next to 0 one power away from it.
    """
    if plot.x.is_categorical:
        places = {x: float(i) for i, x in enumerate(_values(plot))}
        return places.__getitem__
    if not has_two_sides(plot):
        return _drawn
    nearest = min((abs(x) for x in _values(plot) if abs(x) >= _SMALLEST), default=1.0)

    def position(x: float) -> float:
        if abs(x) < nearest or math.isnan(_drawn(x)):
            return 0.0 if abs(x) < nearest else math.nan
        return math.copysign(1 + math.log10(abs(x) / nearest), x)

    return position


def has_two_sides(plot: Plot) -> bool:
    """Whether a logarithmic x axis must show 0, or values below."""
    smallest = min(_values(plot), default=1.0)
    return plot.x.is_log and plot.x.ticks_at_values and smallest < _SMALLEST


def is_log_x(plot: Plot) -> bool:
    """Whether the x axis is logarithmic as drawn: positions are the values themselves."""
    return plot.x.is_log and not has_two_sides(plot)


def _values(plot: Plot) -> list[float]:
    return sorted({x for line in plot.lines for x in line.x})


def ticks(plot: Plot) -> tuple[list[float], list[str]]:
    """Where ticks are, and their labels: at the places, as many as have room."""
    position = positions(plot)
    where = [(position(x), plot.x.text(x)) for x in _values(plot)]
    if plot.x.is_categorical:
        every = -(-len(where) // _MOST_TICKS) or 1
        chosen = where[::every]
    else:
        scale = math.log10 if is_log_x(plot) else float
        at = [(scale(p), p, label) for p, label in where if not math.isnan(p)]
        room = (at[-1][0] - at[0][0]) / _MOST_LETTERS if at else 0.0
        chosen, free_from = [], -math.inf
        for place, p, label in at:
            half = room * (len(label) + 1) / 2
            if place - half >= free_from:
                chosen.append((p, label))
                free_from = place + half
    return [p for p, _ in chosen], [label for _, label in chosen]


def smallest_value(plot: Plot) -> float:
    """The smallest value above 0 of y and its intervals; 1 if there is none."""
    values = (value for line in plot.lines for part in (line.y, line.low) for value in part)
    return min((value for value in values if is_drawn(value)), default=1.0)


def x_limits(plot: Plot) -> tuple[float, float] | None:
    """Limits of the x axis; None where they are left to the data."""
    if plot.x.is_categorical:
        return -0.6, len(_values(plot)) - 0.4
    if plot.x.ticks_at_values:
        return _around_values(plot)
    if plot.x.limits is not None or not plot.x.is_log:
        return plot.x.limits
    points = (point for line in plot.lines for point in zip(line.x, line.y, strict=True))
    seen = (is_drawn(x) and (is_drawn(y) if plot.y.is_log else y == y) for x, y in points)
    return None if any(seen) else _NO_DATA


def _around_values(plot: Plot) -> tuple[float, float] | None:
    """From the first to the last, with a little room beside them for their marks."""
    position = positions(plot)
    where = [p for p in map(position, _values(plot)) if not math.isnan(p)]
    if not where:
        return None
    if is_log_x(plot):
        room = max((where[-1] / where[0]) ** 0.05, 1.1)
        return where[0] / room, where[-1] * room
    room = 0.05 * (where[-1] - where[0]) or max(abs(where[0]) / 2, 0.5)
    return where[0] - room, where[-1] + room


def y_limits(plot: Plot) -> tuple[float, float] | None:
    """Limits of the y axis; None where they are left to the data.

    A bar on a logarithmic axis has no natural foot: it stands on the power of ten below
    the smallest value.
    """
    if plot.y.limits is not None:
        low, high = (min(max(end, -_LARGEST), _LARGEST) for end in plot.y.limits)
        return low, high
    if not plot.y.is_log:
        return None
    parts = [part for line in plot.lines for part in (line.y, line.high)]
    highest = max((value for part in parts for value in part if is_drawn(value)), default=None)
    if highest is None:
        return _NO_DATA
    if plot.x.is_categorical:
        return 10.0 ** (math.ceil(math.log10(smallest_value(plot))) - 1), 1.5 * highest
    return None
