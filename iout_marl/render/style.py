"""Sizes and colours of a picture.

Orange is energy, blue is data, and the colour of a node its age. All are told by shape,
width or dashes too, so that no reading depends on colours alone.
"""

from __future__ import annotations

DPI = 100
WIDTH_PX, HEIGHT_PX = 960, 600
PT_PER_PX = 72 / DPI

INK, MUTED, HAIRLINE = "#22303c", "#5f6c78", "#d3dde6"
WATER, AUV = "#f2f7fb", "#14334d"
# From the palette of Okabe and Ito, told apart whatever the eye's colour vision.
ENERGY, DATA, FAILED = "#e69f00", "#0072b2", "#d55e00"
AGE_COLOURS = "viridis_r"

SMALL_PT = 7.5

#: Left, bottom, width and height in px of each panel.
Box = tuple[float, float, float, float]
MAP: Box = (44, 76, 446, 446)
COLOURBAR: Box = (508, 76, 11, 446)
PROFILE: Box = (606, 387, 336, 135)
AGES: Box = (606, 230, 336, 104)
ENERGIES: Box = (606, 76, 336, 104)
