"""What the tables of the pages are written with."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def table(headings: Sequence[str], rows: Iterable[Iterable[str]]) -> str:
    """A table of cells that are Markdown already."""
    lines = [headings, ["---"] * len(headings), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def numeral(value: float) -> str:
    """A number to three digits, or whole with commas from 1,000 on."""
    return (f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}").replace("-", "−")


def page_of(blocks: Iterable[str]) -> str:
    """Blocks with an empty line between them."""
    return "\n".join(f"{block.rstrip()}\n" for block in blocks)
