"""A part of a picture with coordinates of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from iout_marl.render import style

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch


class Panel:
    """A box of the figure; numbers and names are written beside it.

    No `Axes`: to make one and its ticks takes as long as to draw all that is in a panel.

    Args:
        figure: the figure.
        box: where the panel lies in it, in px.
        across, along: ends of the horizontal and of the vertical axis.
    """

    def __init__(
        self,
        figure: Figure,
        box: style.Box,
        across: tuple[float, float],
        along: tuple[float, float],
    ) -> None:
        from matplotlib.transforms import Affine2D

        left, bottom, self._width_px, self._height_px = box
        self._figure, self._across, self._along = figure, across, along
        # Not px of the figure, which may be saved with more of them.
        px = Affine2D().translate(left, bottom).scale(1 / style.DPI) + figure.dpi_scale_trans
        width, height = across[1] - across[0], along[1] - along[0]
        own = Affine2D().translate(-across[0], -along[0])
        self._px = px
        self._transform = own.scale(self._width_px / width, self._height_px / height) + px

    def draw_line(self, x: npt.ArrayLike, y: npt.ArrayLike, /, **look: Any) -> None:
        """Draw a line, or marks, in the panel's coordinates."""
        from matplotlib.lines import Line2D

        self._add(Line2D(np.atleast_1d(x), np.atleast_1d(y), **look))

    def draw_segments(self, segments: Sequence[Any], **look: Any) -> None:
        """Draw straight lines, (lines, ends, 2)."""
        from matplotlib.collections import LineCollection

        self._add(LineCollection(segments, **look))

    def draw_patches(self, patches: Sequence[Patch], **look: Any) -> None:
        """Draw what is filled."""
        from matplotlib.collections import PatchCollection

        self._add(PatchCollection(patches, **look))

    def draw_across(self, heights: Iterable[float], **look: Any) -> None:
        """Draw horizontal lines through the panel."""
        low, high = self._across
        self.draw_segments([[(low, y), (high, y)] for y in heights], **look)

    def _add(self, artist: Artist) -> None:
        artist.set_transform(self._transform)
        self._figure.add_artist(artist)

    def write(self, x: float, y: float, text: str, **options: Any) -> None:
        """Write at a place in the panel's coordinates."""
        usual: dict[str, Any] = {"color": style.INK, "ha": "center", "transform": self._transform}
        self._figure.text(x, y, text, **usual | options)

    def fill(self, colours: Sequence[Any]) -> None:
        """Fill the panel with colours, one above the other."""
        from matplotlib.patches import Rectangle

        (left, right), (low, high) = self._across, self._along
        # Each reaches up beneath the next: no gap shows between two.
        shades = [
            Rectangle((left, y), right - left, high - y)
            for y in np.linspace(low, high, len(colours) + 1)[:-1]
        ]
        self.draw_patches(shades, facecolors=colours, linewidths=0)

    def number_across(
        self, values: Iterable[float], place: Callable[[float], float] = float
    ) -> None:
        """Write numbers below the panel, each at the coordinate that `place` gives it."""
        low, high = self._across
        for value in values:
            self._beside((place(value) - low) / (high - low) * self._width_px, -11, f"{value:g}")

    def number_along(
        self,
        values: Iterable[float],
        place: Callable[[float], float] = float,
        *,
        right: bool = False,
    ) -> None:
        """Write numbers to the left of the panel, or to its right."""
        low, high = self._along
        x_px, side = (self._width_px + 6, "left") if right else (-6, "right")
        for value in values:
            y_px = (place(value) - low) / (high - low) * self._height_px
            self._beside(x_px, y_px, f"{value:g}", ha=side)

    def name_across(self, name: str) -> None:
        """Write the name of the horizontal axis below its numbers."""
        self._beside(self._width_px / 2, -23, name)

    def name_along(self, name: str) -> None:
        """Write the name of the vertical axis to the left of its numbers."""
        self._beside(-26, self._height_px / 2, name)

    def write_right(self, text: str) -> None:
        """Write upwards to the right of the numbers on the right."""
        self._beside(self._width_px + 28, self._height_px / 2, text, rotation=90, va="center")

    def title(self, text: str, note: str = "") -> None:
        """Write a title above the panel, and at its right end a note."""
        bold: dict[str, Any] = {"fontsize": 9, "fontweight": "bold", "color": style.INK}
        self._beside(0, self._height_px + 13, text, ha="left", **bold)
        if note:
            self._beside(self._width_px, self._height_px + 13, note, ha="right")

    def _beside(self, x_px: float, y_px: float, text: str, **options: Any) -> None:
        """Write at a place counted in px from the panel's lower left corner."""
        usual: dict[str, Any] = {
            "fontsize": style.SMALL_PT,
            "color": style.MUTED,
            "ha": "center",
            "va": "center_baseline",
            "transform": self._px,
        }
        self._figure.text(x_px, y_px, text, **usual | options)
