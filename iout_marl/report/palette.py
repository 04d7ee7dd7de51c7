"""Colours of the report's figures, one set for light and dark pages alike.

The hues are those of Okabe and Ito, told apart whatever the eye's colour vision; the light
ones are darkened until every colour has a contrast of 3 to white and to a dark page. Lines
of the same colour are told apart by their marks too.
"""

from __future__ import annotations

#: Blue, orange, green, vermilion, purple, sky, grey, olive.
COLOURS = (
    "#0072b2",
    "#bf8300",
    "#009e73",
    "#d55e00",
    "#c773a1",
    "#2b9bd6",
    "#7a7f87",
    "#8f8500",
)
#: The one of them that is no hue.
GREY = 6
#: From the first slot to the last: their order shows by hue, and no end fades into a page.
SLOTS = ("#7257cf", "#2f7fc4", "#1c9c83", "#62a52a", "#a89f06")
#: As in the pictures of an environment: orange is energy, blue is data.
CHARGED, HEARD, FAILED = COLOURS[1], COLOURS[0], COLOURS[3]
NODE = COLOURS[GREY]

#: Marks by index: what matplotlib calls them, and what Plotly does. Their number shares no
#: factor with that of the colours, so that lines beyond the last colour differ by the mark.
MARKS = (
    ("o", "circle"),
    ("s", "square"),
    ("^", "triangle-up"),
    ("D", "diamond"),
    ("v", "triangle-down"),
    ("P", "cross"),
    ("X", "x"),
)


def colour(index: int) -> str:
    """The colour of an index, `#rrggbb`; they recur after the last."""
    return COLOURS[index % len(COLOURS)]


def translucent(colour: str, alpha: float) -> str:
    """A colour `#rrggbb` as `rgba(...)`, alpha from 0 to 1."""
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},{alpha:g})"
