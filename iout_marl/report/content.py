"""What a report consists of, free of any format: sections, tables, figures, answers.

`page` writes it as a web page, `markdown` as a text; `static` and `interactive` draw its
figures. Texts are plain; words between backticks are code (see `markup`).
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

from iout_marl.report.markup import plain_text

#: What is added to a verdict that rests on too few runs.
PROVISIONAL = ", provisionally"
#: How well a claim held.
Verdict: TypeAlias = Literal[
    "reproduced", "reproduced in part", "left open", "not reproduced", "not measured"
]


@dataclass(frozen=True)
class Line:
    """One curve, or one bar of every group, of a `Plot`.

    Attributes:
        name: what the legend calls it.
        x, y: the points.
        low, high: 95 % confidence interval at every point; empty where there is none. A
            single point without one has NaN.
        dashed: drawn so.
        joined: False for points alone.
        colour: which colour of the palette, where lines of several names belong together.
        in_legend: False for a line that shares the legend's entry of another.
    """

    name: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()
    dashed: bool = False
    joined: bool = True
    colour: int | None = None
    in_legend: bool = True


@dataclass(frozen=True)
class Plot:
    """Lines or grouped bars over a common axis.

    Attributes:
        key: name of its files, and its anchor in the page.
        caption: what it shows: seeds, episodes, what is scored, what the interval is of.
        command: what makes it.
        categories: the values of x are categories (K = 3, 5, 7, 10): equally spaced ticks
            at these values alone.
        places: x is a continuous axis with ticks at its few values alone, the places at which
            something was measured; only these may be 0 or below on a logarithmic axis.
        x_range, y_range: limits of the axes; None for those of the data.
    """

    key: str
    title: str
    caption: str
    command: str
    x_label: str
    y_label: str
    lines: tuple[Line, ...]
    kind: Literal["lines", "bars"] = "lines"
    log_y: bool = False
    log_x: bool = False
    categories: bool = False
    places: bool = False
    x_range: tuple[float, float] | None = None
    y_range: tuple[float, float] | None = None

    @property
    def at_places(self) -> bool:
        """Whether its points are few and single ones: not those of a curve."""
        return self.categories or self.places

    def rows(self) -> Iterator[tuple[object, ...]]:
        """The data as a table, its headings first."""
        yield ("series", self.x_label, self.y_label, "ci95_low", "ci95_high")
        for line in self.lines:
            for i, (x, y) in enumerate(zip(line.x, line.y, strict=True)):
                interval = (line.low[i], line.high[i]) if line.low else ("", "")
                yield (line.name, x, y, *interval)


@dataclass(frozen=True)
class Trajectory:
    """The path of one AUV through the grid, and whom it charged and heard.

    Cells are counted from 1, nodes from 1.

    Attributes:
        grid: cells along x, y and z.
        spacing_m: edge of a cell in m.
        nodes: (nodes, 3) cells.
        path: (slots + 1, 3) cells, the start first.
        charged: (slots,) node charged in each slot; 0 for none.
        heard: (slots,) node heard in each slot; 0 for none.
        delivered: (slots,) whether its packet arrived.
        ages: (slots, nodes) ages after each slot.
    """

    key: str
    title: str
    caption: str
    command: str
    grid: tuple[int, int, int]
    spacing_m: float
    nodes: tuple[tuple[int, int, int], ...]
    path: tuple[tuple[int, int, int], ...]
    charged: tuple[int, ...]
    heard: tuple[int, ...]
    delivered: tuple[bool, ...]
    ages: tuple[tuple[int, ...], ...]

    def rows(self) -> Iterator[tuple[object, ...]]:
        """The data as a table, its headings first."""
        nodes = [f"age_node_{i + 1}" for i in range(len(self.nodes))]
        yield ("slot", "x_cell", "y_cell", "z_cell", "charged", "heard", "delivered", *nodes)
        slots = zip(self.path[1:], self.charged, self.heard, self.delivered, self.ages, strict=True)
        for slot, (cell, charged, heard, delivered, ages) in enumerate(slots, start=1):
            yield (slot, *cell, charged, heard, int(delivered), *ages)


Figure: TypeAlias = Plot | Trajectory


@dataclass(frozen=True)
class Table:
    """A table of texts, made to be read.

    Attributes:
        columns: headings; those of numbers stand in `numeric`.
        numeric: indices of the columns that are set flush right.
        marked: (row, column) of the cells to stand out.
    """

    key: str
    title: str
    caption: str
    command: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    numeric: frozenset[int] = frozenset()
    marked: frozenset[tuple[int, int]] = frozenset()


@dataclass(frozen=True)
class Answer:
    """A claim of the paper, and what was measured.

    Attributes:
        claim: its identifier.
        source: figure or table of the paper.
        text: the claim.
        value: the figure that the paper gives; may be empty.
        verdict: how well it held.
        measured: the measured figures, with their intervals.
        explanation: where it did not hold, the measurement that shows why; else empty.
        provisional: whether it rests on too few runs to be the last word.
    """

    claim: str
    source: str
    text: str
    value: str
    verdict: Verdict
    measured: tuple[str, ...]
    explanation: tuple[str, ...] = ()
    provisional: bool = False

    @property
    def judged(self) -> str:
        """The verdict in words."""
        return f"{self.verdict}{PROVISIONAL if self.provisional else ''}"


@dataclass(frozen=True)
class Answers:
    """The claims, one by one."""

    key: str
    caption: str
    command: str
    answers: tuple[Answer, ...]

    @property
    def provisional(self) -> bool:
        """Whether any of the verdicts is."""
        return any(answer.provisional for answer in self.answers)

    def count(self, verdict: Verdict) -> int:
        """How many claims got this verdict."""
        return sum(answer.verdict == verdict for answer in self.answers)


@dataclass(frozen=True)
class Section:
    """A part of the report.

    Attributes:
        paragraphs: its text, before its items.
    """

    key: str
    title: str
    paragraphs: tuple[str, ...] = ()
    items: tuple[Figure | Table | Answers, ...] = ()


@dataclass(frozen=True)
class Report:
    """A whole report.

    Attributes:
        lead: the result in a few sentences.
        facts: machine, versions, date and the like: name and value.
    """

    title: str
    lead: tuple[str, ...]
    facts: tuple[tuple[str, str], ...]
    sections: tuple[Section, ...]

    def figures(self) -> Iterator[Figure]:
        """All figures, in their order."""
        for section in self.sections:
            for item in section.items:
                if isinstance(item, Plot | Trajectory):
                    yield item


def to_csv(rows: Iterator[tuple[object, ...]]) -> str:
    """Rows as CSV."""
    text = io.StringIO()
    plain = ([plain_text(cell) if isinstance(cell, str) else cell for cell in row] for row in rows)
    csv.writer(text, lineterminator="\n").writerows(plain)
    return text.getvalue()
