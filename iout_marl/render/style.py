"""Sizes and colours of pictures.

Orange is energy, blue is data, and the colour of a node its age. All differ in shape,
width or dashes too, so that no reading depends on colours alone.
"""

from __future__ import annotations

import numpy as np

from iout_marl.render.scene import Passed
from iout_marl.render.snapshot import Floats

DPI = 100
WIDTH_PX, HEIGHT_PX = 960, 600
PT_PER_PX = 72 / DPI

INK, MUTED, HAIRLINE = "#22303c", "#5f6c78", "#d3dde6"
WATER, AUV = "#f2f7fb", "#14334d"
# From the palette of Okabe and Ito, told apart whatever the eye's colour vision.
ENERGY, DATA, FAILED = "#e69f00", "#0072b2", "#d55e00"
AGE_COLOURS = "viridis_r"
#: The same at seventeen ages from 1 to A_max, for what draws without matplotlib.
AGE_STOPS = (
    *("#fde725", "#d5e21a", "#aadc32", "#81d34d", "#5cc863", "#3dbc74"),
    *("#27ad81", "#1f9f88", "#21908d", "#26818e", "#2c718e", "#33628d"),
    *("#3b518b", "#423f85", "#472c7a", "#481769", "#440154"),
)
#: What passes between AUVs and nodes: colours and dashes, and the mark where the AUV was.
LINKS = {Passed.CHARGE: ENERGY, Passed.PACKET: DATA, Passed.LOSS: FAILED}
DASHES = {Passed.CHARGE: "-", Passed.PACKET: "-", Passed.LOSS: (0, (4, 2.5))}
MARKS = {Passed.PACKET: "o", Passed.LOSS: "X"}
#: The same hues, the light ones darkened until every colour has a contrast of 3 to white and to a
#: dark page: blue, orange, green, vermilion, purple, sky, grey, olive.
COLOURS = (
    *("#0072b2", "#bf8300", "#009e73", "#d55e00"),
    *("#c773a1", "#2b9bd6", "#7a7f87", "#8f8500"),
)
#: From the first slot to the last: their order shows by hue, and no end fades into a page.
SLOTS = ("#7257cf", "#2f7fc4", "#1c9c83", "#62a52a", "#a89f06")
#: Colours of several AUVs: green, purple, olive, sky, violet; none is the colour of what passes.
AUVS = ("#009e73", "#c773a1", "#8f8500", "#2b9bd6", "#7257cf")
#: Share of a battery from which on its bar has the colour of failure.
LOW_BATTERY = 0.2
#: Where AUVs are recharged, the way that one under way has before it, and a node that sleeps.
DOCK, COURSE, ASLEEP = "#dbe3c8", (0, (1, 1.8)), "☾"
#: A node whose age is not shown.
NODE = COLOURS[6]

SMALL_PT = 7.5

#: Left, bottom, width and height in px of each panel.
Box = tuple[float, float, float, float]
MAP: Box = (44, 76, 446, 446)
COLOURBAR: Box = (508, 76, 11, 446)
PROFILE: Box = (606, 387, 336, 135)
AGES: Box = (606, 230, 336, 104)
ENERGIES: Box = (606, 76, 336, 104)


def auv_colour(auv: int) -> str:
    """The colour of one of several AUVs, counted from 0, and of its path."""
    return AUVS[auv % len(AUVS)]


def rgba(colour: str) -> Floats:
    """(4,) parts of a colour `#rrggbb`, from 0 to 1."""
    return np.array([*(int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)), 1.0])


def slot_colours(count: int) -> Floats:
    """(count, 4) colours of slots, from the first to the last."""
    known, at = np.stack([rgba(c) for c in SLOTS]), np.linspace(0, 1, count)
    ends = np.linspace(0, 1, len(SLOTS))
    return np.stack([np.interp(at, ends, part) for part in known.T], axis=-1)


def trail_colours(slots: int, num_auvs: int) -> Floats:
    """(slots, auvs, 4) colours of steps: by slot, of several AUVs by the AUV."""
    if num_auvs == 1:
        return slot_colours(slots)[:, None]
    by_auv = np.stack([rgba(auv_colour(auv)) for auv in range(num_auvs)])
    return np.broadcast_to(by_auv, (slots, num_auvs, 4))
