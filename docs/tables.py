"""Writes the tables that pages have from the software itself: `make docs`.

A table stands between the lines `<!-- NAME -->` and `<!-- end of NAME -->` of its page.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from iout_marl import metrics
from iout_marl.report.markup import markdown_text

HERE = Path(__file__).parent
_BETTER = {"less": "less", "more": "more", None: "–"}


def metrics_table() -> str:
    """The built-in metrics."""
    headings = ("Metric", "Symbol", "Unit", "Better", "Range", "What it is", "TensorBoard")
    rows = [
        (
            f"`{metric.name}`",
            metric.symbol or "–",
            metric.unit or "–",
            _BETTER[metric.better],
            _range(metric),
            metric.definition,
            f"`{metric.tag}`",
        )
        for metric in metrics.BUILTIN
    ]
    return _table(headings, rows)


def _range(metric: metrics.Metric) -> str:
    if math.isinf(metric.low):
        return "any"
    low = f"{'above' if metric.is_positive else 'from'} {metric.low:g}"
    return low if math.isinf(metric.high) else f"{low} to {metric.high:g}"


def _table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [headings, ["---"] * len(headings), *(map(markdown_text, row) for row in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


#: The tables, by name, with the pages that they stand on.
TABLES: dict[str, tuple[Path, Callable[[], str]]] = {
    "metrics": (HERE / "metrics.md", metrics_table),
}


def written(name: str) -> str:
    """The page of a table, with the table as it is now."""
    page, table = TABLES[name]
    text = page.read_text(encoding="utf-8")
    pattern = rf"(<!-- {name} -->\n\n).*?(\n<!-- end of {name} -->\n)"
    parts = re.search(pattern, text, re.DOTALL)
    if parts is None:
        raise ValueError(f"{page}: has no place for the table {name}")
    return f"{text[: parts.start()]}{parts[1]}{table()}{parts[2]}{text[parts.end() :]}"


def main() -> None:
    """Write every table."""
    for name, (page, _) in TABLES.items():
        page.write_text(written(name), encoding="utf-8")


if __name__ == "__main__":
    main()
