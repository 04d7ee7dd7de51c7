"""Looks of the lines and bars in the report's figures, for light and dark pages alike.

Where colours recur, lines differ by mark and dashes, bars by their hatching.
"""

from __future__ import annotations

from dataclasses import dataclass

from iout_marl.render.scene import Passed
from iout_marl.render.style import COLOURS

#: The one of them that is no hue.
GREY = 6
#: As in the pictures of an environment: orange is energy, blue is data.
LINKS = {Passed.CHARGE: COLOURS[1], Passed.PACKET: COLOURS[0], Passed.LOSS: COLOURS[3]}

#: Marks: what matplotlib calls them, and what Plotly does. Their number shares no factor with
#: that of the colours, so that the first 56 lines differ by these two alone.
MARKS = (
    ("o", "circle"),
    ("s", "square"),
    ("^", "triangle-up"),
    ("D", "diamond"),
    ("v", "triangle-down"),
    ("P", "cross"),
    ("X", "x"),
)
#: Strokes and gaps in px for the first eight lines, the next eight, ...; none is a whole line.
DASHES = ((), (2, 3), (9, 3, 2, 3), (14, 4), (5, 2, 2, 2, 2, 2))
#: The dashes of lines that are drawn so for what they mean, whatever their colour.
DASHED = (8, 4)
#: Hatching: what matplotlib calls it, what Plotly does, and its size there in px. Bars of the
#: first eight lines have one of the first three, those of the next eight of the next three, ...
HATCHES = (
    *(("", "", 8), ("\\\\\\\\", "\\", 8), ("xxx", "x", 8)),
    *(("...", ".", 8), ("---", "-", 8), ("|||", "|", 8)),
    *(("+++", "+", 8), ("\\\\", "\\", 16), ("oo", ".", 16)),
)
#: Which of the three, by colour: those that look alike to the red-green blind differ.
_HATCH_OF = (0, 0, 0, 1, 0, 0, 1, 2)
#: The hatching of bars where lines would be dashed.
HATCHED = ("///", "/", 8)


@dataclass(frozen=True)
class Look:
    """How a line or a bar is drawn.

    Attributes:
        colour: `#rrggbb`.
        mark: what matplotlib and Plotly call it.
        dash: strokes and gaps in px; empty for a whole line.
        hatch: what matplotlib and Plotly call it, and its size there in px.
    """

    colour: str
    mark: tuple[str, str]
    dash: tuple[int, ...]
    hatch: tuple[str, str, int]


def look(index: int, *, dashed: bool = False) -> Look:
    """The look of an index; the first 280 lines differ from one another, the first 24 bars."""
    group, number = divmod(index, len(COLOURS))
    hatch = (3 * group + _HATCH_OF[number]) % len(HATCHES)
    return Look(
        colour(index),
        MARKS[index % len(MARKS)],
        DASHED if dashed else DASHES[group % len(DASHES)],
        HATCHED if dashed else HATCHES[hatch],
    )


def colour(index: int) -> str:
    """The colour of an index, `#rrggbb`; they recur after the last."""
    return COLOURS[index % len(COLOURS)]


def hue(number: int) -> int:
    """The index of a look that is not grey, the first, the second, ... from 0 on."""
    rounds, place = divmod(number, len(COLOURS) - 1)
    return rounds * len(COLOURS) + place + (place >= GREY)


def translucent(colour: str, alpha: float) -> str:
    """A colour `#rrggbb` as `rgba(...)`, alpha from 0 to 1."""
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},{alpha:g})"
