"""Words of messages and tables."""

from __future__ import annotations

import math
from collections.abc import Sequence


def counted(number: int, noun: str, several: str = "") -> str:
    """'1 episode', '2 episodes'; `several` where an s will not do."""
    return f"{number:,} {noun if number == 1 else several or noun + 's'}"


def listed(words: Sequence[str]) -> str:
    """'a', 'a and b', 'a, b and c'."""
    return " and ".join(filter(None, [", ".join(words[:-1]), *words[-1:]]))


def place_text(place: float) -> str:
    """A place on the axis: `3`, `0.5`, `2,304,000`."""
    if not math.isfinite(place):
        return "–"
    return f"{place:,.12g}".removeprefix("-" if place == 0 else "")
