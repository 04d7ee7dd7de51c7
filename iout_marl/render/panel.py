"""A part of a picture with axes of its own."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from iout_marl.render import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


class Panel:
    """A box of the figure with bare axes; numbers and names are written beside it.

    matplotlib's own ticks would take as long as all the rest of the picture.

    Args:
        figure: the figure.
        box: where the panel lies in it, in px.
        across, along: ends of the horizontal and of the vertical axis.

    Attributes:
        axes: to draw on.
    """

    def __init__(
        self,
        figure: Figure,
        box: style.Box,
        across: tuple[float, float],
        along: tuple[float, float],
    ) -> None:
        left, bottom, self._width_px, self._height_px = box
        whole = style.WIDTH_PX, style.HEIGHT_PX
        self.axes: Axes = figure.add_axes(
            (
                left / whole[0],
                bottom / whole[1],
                self._width_px / whole[0],
                self._height_px / whole[1],
            )
        )
        self.axes.set_axis_off()
        self.axes.set(xlim=across, ylim=along)

    def number_across(self, values: Iterable[float]) -> None:
        """Write numbers below the panel."""
        low, high = self.axes.get_xlim()
        for value in values:
            self._write((value - low) / (high - low) * self._width_px, -11, f"{value:g}")

    def number_along(self, values: Iterable[float], *, right: bool = False) -> None:
        """Write numbers to the left of the panel, or to its right."""
        low, high = self.axes.get_ylim()
        x_px, side = (self._width_px + 6, "left") if right else (-6, "right")
        for value in values:
            y_px = (value - low) / (high - low) * self._height_px
            self._write(x_px, y_px, f"{value:g}", ha=side)

    def name_across(self, name: str) -> None:
        """Write the name of the horizontal axis below its numbers."""
        self._write(self._width_px / 2, -23, name)

    def name_along(self, name: str) -> None:
        """Write the name of the vertical axis to the left of its numbers."""
        self._write(-26, self._height_px / 2, name)

    def write_right(self, text: str) -> None:
        """Write upwards to the right of the numbers on the right."""
        self._write(self._width_px + 28, self._height_px / 2, text, rotation=90)

    def title(self, text: str, note: str = "") -> None:
        """Write a title above the panel, and at its right end a note."""
        bold: dict[str, Any] = {"fontsize": 9, "fontweight": "bold", "color": style.INK}
        self._write(0, self._height_px + 13, text, ha="left", **bold)
        if note:
            self._write(self._width_px, self._height_px + 13, note, ha="right")

    def _write(self, x_px: float, y_px: float, text: str, **options: Any) -> None:
        """Write at a place counted in px from the panel's lower left corner."""
        usual: dict[str, Any] = {
            "fontsize": style.SMALL_PT,
            "color": style.MUTED,
            "ha": "center",
            "va": "center" if "rotation" in options else "center_baseline",
            "transform": self.axes.transAxes,
        }
        self.axes.text(x_px / self._width_px, y_px / self._height_px, text, **{**usual, **options})
