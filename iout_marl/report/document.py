"""What a report consists of, free of any format: sections, tables, figures, answers.

`page` writes it as a web page, `markdown` as a text. Texts are plain; words between backticks are
code (see `markup`).
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

from iout_marl.report.figure import Figure
from iout_marl.report.markup import plain_text

#: What is added to a verdict that rests on too few runs.
PROVISIONAL = ", provisionally"
#: How well a claim held.
Verdict: TypeAlias = Literal[
    "reproduced", "reproduced in part", "left open", "not reproduced", "not measured"
]


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
    """A claim of a publication, and what was measured.

    Attributes:
        claim: its identifier.
        source: the figure or table that it is made of.
        text: the claim.
        value: the claimed number; may be empty.
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
                if isinstance(item, Figure):
                    yield item


def to_csv(rows: Iterator[tuple[object, ...]]) -> str:
    """Rows as CSV."""
    text = io.StringIO()
    plain = ([plain_text(cell) if isinstance(cell, str) else cell for cell in row] for row in rows)
    csv.writer(text, lineterminator="\n").writerows(plain)
    return text.getvalue()
