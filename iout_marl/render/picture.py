"""An environment as pixels: the map from above, the depth profile, ages and energies."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from rich.cells import cell_len

from iout_marl.render import style
from iout_marl.render.labels import energy_text, energy_unit, number_text, shortened
from iout_marl.render.layout import axis_top, round_step
from iout_marl.render.panel import Panel
from iout_marl.render.scene import FROM_ABOVE, FROM_THE_SIDE, draw_scene, hull
from iout_marl.render.settings import drawing
from iout_marl.render.snapshot import Floats, Snapshot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST_VALUES = 14  # nodes whose numbers fit above their bars


def as_picture(snapshot: Snapshot) -> npt.NDArray[np.uint8]:
    """The environment as pixels, (600, 960, 3).

    To the left the map from above: the colour of a node is its age, the ring around it
    closes when the energy stored pays an uplink over half the grid; AUVs carry their
    depth, and lines show what they charged and heard in the last slot. To the right the
    same from the side, z downwards, and the age and the energy of every node.
    """
    title = shortened(snapshot.title, 42)
    with drawing(title) as replaced:
        return _draw(replace(snapshot.drawable(), title=title.translate(replaced)))


def _draw(snapshot: Snapshot) -> npt.NDArray[np.uint8]:
    # Without pyplot, nothing is shared with the caller and no figure needs closing.
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    size_inches = (style.WIDTH_PX / style.DPI, style.HEIGHT_PX / style.DPI)
    figure = Figure(figsize=size_inches, dpi=style.DPI, facecolor="white")
    canvas: Any = FigureCanvasAgg(figure)  # its methods have no types
    scale = mpl.colormaps[style.AGE_COLOURS](np.linspace(0, 1, 256))
    colours = scale[_age_shades(snapshot)]

    _draw_header(figure, snapshot)
    draw_scene(figure, snapshot, FROM_ABOVE, style.MAP, colours)
    _draw_colourbar(figure, snapshot, scale)
    title = "Depth profile, from the side"
    draw_scene(figure, snapshot, FROM_THE_SIDE, style.PROFILE, colours, title)
    _draw_ages(figure, snapshot, colours)
    _draw_energies(figure, snapshot)
    _draw_legend(figure, snapshot)

    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _age_top(s: Snapshot) -> float:
    """The upper end of the axis of ages, which is none if A_max is 1."""
    return max(s.maximum_age, 2.0)


def _age_shades(s: Snapshot) -> npt.NDArray[np.int64]:
    """(nodes,) shade of each age, of 256 from 1 to A_max."""
    share = (s.ages - 1) / (_age_top(s) - 1)
    return np.clip(share * 255, 0, 255).astype(np.int64)


def _write(figure: Figure, x_px: float, y_px: float, text: str, **options: Any) -> None:
    """Text at a place counted from the top left."""
    options = {"color": style.INK, "va": "center", **options}
    figure.text(x_px / style.WIDTH_PX, 1 - y_px / style.HEIGHT_PX, text, **options)


def _draw_header(figure: Figure, s: Snapshot) -> None:
    from matplotlib.patches import Rectangle

    over = min(s.slot / max(s.num_slots, 1), 1.0)
    title_pt = 15 if cell_len(s.title) <= 28 else 10.5
    _write(figure, 18, 25, s.title, fontsize=title_pt, fontweight="bold")
    facts = {
        "slot": f"{number_text(s.slot)} / {number_text(s.num_slots)}",
        "mean AoI, slots": number_text(s.mean_age, 1),
        "Jain's index": f"{s.jain:.2f}",
        "harvested": f"{number_text(s.total_harvested_j / 1000, 2)} kJ",
        "duplex": s.duplex,
    }
    for x_px, (name, value) in zip((440, 552, 662, 768, 892), facts.items(), strict=True):
        _write(figure, x_px, 16, name, fontsize=style.SMALL_PT, color=style.MUTED)
        _write(figure, x_px, 33, value, fontsize=11.5, fontweight="bold")
    # How much of the episode is over.
    whole_px = style.WIDTH_PX - 36
    for length_px, colour in ((whole_px, style.HAIRLINE), (over * whole_px, style.DATA)):
        corner = (18 / style.WIDTH_PX, 1 - 49 / style.HEIGHT_PX)
        size = (length_px / style.WIDTH_PX, 3 / style.HEIGHT_PX)
        figure.add_artist(Rectangle(corner, *size, color=colour, linewidth=0))


def _draw_colourbar(figure: Figure, s: Snapshot, scale: Floats) -> None:
    top = _age_top(s)
    panel = Panel(figure, style.COLOURBAR, across=(0, 1), along=(1, top))
    extent = (0, 1, 1, top)
    panel.axes.imshow(scale[:, None, :], origin="lower", extent=extent, aspect="auto")
    panel.number_along(_ticks(1, top), right=True)
    panel.write_right("Age of Information in slots")


def _ticks(low: float, high: float) -> list[float]:
    """Both ends, and round numbers between them as far as they leave them room."""
    step = round_step((high - low) / 6)
    between = np.arange(step, high, step)
    return [low, *between[(between >= low + step / 2) & (between <= high - step / 2)], high]


def _draw_ages(figure: Figure, s: Snapshot, colours: Floats) -> None:
    labels = [number_text(age) for age in s.ages]
    panel = _draw_bars(figure, style.AGES, s.ages, _age_top(s), colours, labels)
    panel.title("Age of Information, slots")


def _draw_energies(figure: Figure, s: Snapshot) -> None:
    top_j, yardstick_j = axis_top(s.energies_j, s.energy_yardstick_j), s.energy_yardstick_j
    unit_j, unit = energy_unit(top_j / 5)  # so that most are above 1 of it
    # What a rounding has left behind is nothing.
    energies = np.where(s.energies_j > 1e-5 * top_j, s.energies_j, 0.0) / unit_j
    labels = [f"{float(f'{energy:.3g}'):g}" for energy in energies]
    panel = _draw_bars(figure, style.ENERGIES, energies, top_j / unit_j, style.ENERGY, labels)
    panel.name_across("node")
    note = ""
    if yardstick_j <= top_j:
        note = f"- - -  {energy_text(yardstick_j)}, an uplink over half the grid"
        dashes: dict[str, Any] = {"linewidth": 0.9, "linestyle": (0, (3, 2))}
        panel.axes.axhline(yardstick_j / unit_j, color=style.INK, zorder=1.5, **dashes)
    panel.title(f"Stored energy, {unit}", note)


def _draw_bars(
    figure: Figure, box: style.Box, values: Floats, top: float, colours: Any, labels: list[str]
) -> Panel:
    """A bar for each node; what passes the top ends there, with an arrow."""
    from matplotlib.collections import LineCollection

    count = len(values)
    places = max(count, 3)
    nodes = np.arange(1, count + 1)
    middle = (count + 1) / 2
    panel = Panel(
        figure,
        box,
        across=(middle - places / 2, middle + places / 2),
        along=(0, 1.13 * top),  # with room for the number of the highest bar
    )
    # As many numbers as there is room for, according to their digits.
    every = round_step(count * len(str(count)) / 40)
    panel.number_across(nodes[every - 1 :: every])
    panel.number_along([0, top / 2, top])
    for height in (0, top / 2, top):
        panel.axes.axhline(height, color=style.HAIRLINE, linewidth=0.8, zorder=1)

    heights = np.minimum(values, top)
    # Thick lines: a thousand of them are drawn as quickly as a few bars.
    panel.axes.add_collection(
        LineCollection(
            [[(node, 0), (node, height)] for node, height in zip(nodes, heights, strict=True)],
            colors=colours,
            linewidths=0.68 * style.PT_PER_PX * min(box[2] / places, 44),
            capstyle="butt",
            zorder=2,
        ),
        autolim=False,
    )
    if count <= _MOST_VALUES:
        px = 1.13 * top / box[3]
        for node, value, height, label in zip(nodes.tolist(), values, heights, labels, strict=True):
            panel.axes.text(
                node,
                height + 3 * px,
                label + ("↑" if value > top else ""),
                fontsize=7,
                color=style.INK,
                ha="center",
                va="bottom",
                zorder=3,
                bbox={"boxstyle": "square,pad=0", "fc": "white", "ec": "none", "alpha": 0.85},
            )
    return panel


def _draw_legend(figure: Figure, s: Snapshot) -> None:
    from matplotlib.lines import Line2D

    def line(label: str, **options: Any) -> Line2D:
        return Line2D([], [], label=label, **options)

    ring = f"ring: energy stored, closed at {energy_text(s.energy_yardstick_j)}"
    handles = [
        line("AUV at depth z", color="none", marker=hull(), ms=22, mfc=style.AUV, mec="none"),
        line("charging", color=style.ENERGY, alpha=0.45, lw=6.5),
        line("packet delivered", color=style.DATA, lw=1.6, marker=">", ms=6),
        line("no packet", color=style.FAILED, lw=1.6, ls=(0, (4, 2.5)), marker="X", ms=7),
        line(ring, color="none", marker="o", ms=10, mfc="white", mec=style.ENERGY, mew=2.5),
    ]
    figure.legend(
        handles=handles,
        loc="lower left",
        bbox_to_anchor=(0.012, 0.005),
        ncols=len(handles),
        frameon=False,
        fontsize=8,
        labelcolor=style.INK,
        handlelength=2.6,
        columnspacing=2.2,
    )
