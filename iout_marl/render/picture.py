"""An environment as pixels: the map from above, the depth profile, ages and energies."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from rich.cells import cell_len

from iout_marl.render import style
from iout_marl.render.hull import hull_path
from iout_marl.render.labels import (
    age_text,
    energy_text,
    energy_unit,
    number_text,
    shortened,
    total_energy_text,
)
from iout_marl.render.layout import axis_top, round_step
from iout_marl.render.panel import Panel
from iout_marl.render.projection import FROM_ABOVE, FROM_THE_SIDE, Projection
from iout_marl.render.scene import Scene
from iout_marl.render.settings import drawing
from iout_marl.render.snapshot import Floats, Snapshot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LEGENDS_A_ROW = 5
_HEADROOM = 1.2  # of the axis of bars, with room for the number of the highest
_MOST_VALUES = 14  # nodes whose numbers fit above their bars


def as_picture(
    snapshot: Snapshot, trail: Floats | None = None, energies_to_j: float = 0.0
) -> npt.NDArray[np.uint8]:
    """The environment as pixels, (600, 960, 3).

    To the left the map from above: the colour of a node is its age, the ring around it
    closes when the energy stored pays an uplink over half the grid, or fills the store; AUVs
    carry their depth, and lines show what they charged and heard in the last slot. To the right
    the same from the side, z downwards, and the age and the energy of every node.

    Args:
        snapshot: what is shown.
        trail: (places, auvs, 3) where the AUVs were in the slots before, in cells; None for no
            trail.
        energies_to_j: an energy that the axis of energies has room for, as that beside it does.
    """
    title = shortened(snapshot.title, 42)
    with drawing(title) as replaced:
        s = snapshot.drawable()
        return _draw(
            s,
            trail,
            _Frame(
                title=title.translate(replaced),
                duplex=s.duplex,
                grid_shape=s.grid_shape,
                edges_m=s.edges_m,
                num_nodes=s.num_nodes,
                age_top=max(s.maximum_age, 2.0),
                energy_top_j=axis_top(np.append(s.energies_j, energies_to_j), s.energy_yardstick_j),
                yardstick_j=s.energy_yardstick_j,
                yardstick_text=s.yardstick_text,
                has_battery=s.battery is not None,
                has_docks=s.docks is not None,
                takes_slots=s.transit_slots is not None,
                can_sleep=s.capacity_j is not None,
            ),
        )


@dataclass(frozen=True)
class _Frame:
    """What stays from one picture to the next, as a rule: all but nodes, AUVs, links and bars.

    Attributes:
        title, duplex: names.
        grid_shape: cells along x, y and z.
        edges_m: edges of a cell along x, y and z.
        num_nodes: how many bars there are.
        age_top: the upper end of the axis of ages in slots, which is none if A_max is 1.
        energy_top_j, yardstick_j: the upper end of the axis of energies, and the full gauge.
        has_battery, has_docks, takes_slots, can_sleep: what else the legend has to explain.
    """

    title: str
    duplex: str
    grid_shape: tuple[int, int, int]
    edges_m: tuple[float, float, float]
    num_nodes: int
    age_top: float
    energy_top_j: float
    yardstick_j: float
    yardstick_text: str
    has_battery: bool
    has_docks: bool
    takes_slots: bool
    can_sleep: bool

    def energy_unit(self) -> tuple[float, str]:
        """The unit of the axis of energies, so that most are above 1 of it."""
        return energy_unit(self.energy_top_j / 5)

    def projections(self, figure: Figure) -> tuple[Projection, Projection]:
        """From above, and from the side."""
        return (
            Projection(figure, FROM_ABOVE, self.grid_shape, style.MAP, self.edges_m),
            Projection(figure, FROM_THE_SIDE, self.grid_shape, style.PROFILE, self.edges_m),
        )

    def bars(self, figure: Figure) -> tuple[_Bars, _Bars]:
        """The bars of ages, and of energies."""
        energy_top = self.energy_top_j / self.energy_unit()[0]
        return (
            _Bars(figure, style.AGES, self.num_nodes, self.age_top),
            _Bars(figure, style.ENERGIES, self.num_nodes, energy_top),
        )


def _new_figure() -> tuple[Figure, Any]:
    # Without pyplot, nothing is shared with the caller and no figure needs closing.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    size_inches = (style.WIDTH_PX / style.DPI, style.HEIGHT_PX / style.DPI)
    figure = Figure(figsize=size_inches, dpi=style.DPI, facecolor="white")
    return figure, FigureCanvasAgg(figure)  # whose methods have no types


def _draw(s: Snapshot, trail: Floats | None, frame: _Frame) -> npt.NDArray[np.uint8]:
    figure, canvas = _new_figure()
    colours = _age_colours()[_age_shades(s.ages, frame.age_top)]
    _draw_progress(figure, s)
    scene = Scene.from_snapshot(s, trail)
    for projection in frame.projections(figure):
        projection.draw(scene, colours)
    ages, energies = frame.bars(figure)
    ages.draw(s.ages, colours, [age_text(age) for age in s.ages])
    # What a rounding has left behind is nothing.
    energies_j = np.where(s.energies_j > 1e-5 * frame.energy_top_j, s.energies_j, 0.0)
    values = energies_j / frame.energy_unit()[0]
    energies.draw(values, style.ENERGY, [f"{float(f'{value:.3g}'):g}" for value in values])

    renderer = canvas.get_renderer()
    pixels = np.asarray(renderer.buffer_rgba())
    pixels[:] = _background(frame)
    figure.patch.set_visible(False)
    figure.draw(renderer)
    return pixels[..., :3].copy()


@lru_cache(maxsize=8)
def _background(frame: _Frame) -> npt.NDArray[np.uint8]:
    """(600, 960, 4) pixels of what lies behind nodes, AUVs, links and bars."""
    figure, canvas = _new_figure()
    _draw_header(figure, frame)
    above, from_the_side = frame.projections(figure)
    above.draw_grid()
    from_the_side.draw_grid("Depth profile, from the side")
    _draw_colourbar(figure, frame.age_top)
    ages, energies = frame.bars(figure)
    ages.draw_axes()
    ages.panel.title("Age of Information, slots")
    energies.draw_axes()
    energies.panel.name_across("node")
    unit_j, unit = frame.energy_unit()
    note = ""
    if frame.yardstick_j <= frame.energy_top_j:
        note = f"- - -  {energy_text(frame.yardstick_j)}, {frame.yardstick_text}"
        dashes: dict[str, Any] = {"linewidths": 0.9, "linestyles": [(0, (3, 2))], "zorder": 1.5}
        energies.panel.draw_across([frame.yardstick_j / unit_j], colors=style.INK, **dashes)
    energies.panel.title(f"Stored energy, {unit}", note)
    _draw_legend(figure, frame)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba()).copy()


@cache
def _age_colours() -> Floats:
    """(256, 4) colours of ages from 1 to A_max."""
    import matplotlib as mpl

    shades: Floats = mpl.colormaps[style.AGE_COLOURS](np.linspace(0, 1, 256))
    return shades


def _age_shades(ages: Floats, top: float) -> npt.NDArray[np.int64]:
    """(nodes,) shade of each age, of 256 from 1 to the top."""
    return np.clip((ages - 1) / (top - 1) * 255, 0, 255).astype(np.int64)


def _write(figure: Figure, x_px: float, y_px: float, text: str, **options: Any) -> None:
    """Text at a place counted from the top left."""
    options = {"color": style.INK, "va": "center", **options}
    figure.text(x_px / style.WIDTH_PX, 1 - y_px / style.HEIGHT_PX, text, **options)


#: From the left: facts of the header, in px.
_FACTS = {
    "slot": 440,
    "mean AoI, slots": 552,
    "Jain's index": 662,
    "harvested": 768,
    "duplex": 892,
}


def _draw_header(figure: Figure, frame: _Frame) -> None:
    title_pt = 15 if cell_len(frame.title) <= 28 else 10.5
    _write(figure, 18, 25, frame.title, fontsize=title_pt, fontweight="bold")
    for name, x_px in _FACTS.items():
        _write(figure, x_px, 16, name, fontsize=style.SMALL_PT, color=style.MUTED)
    _write_fact(figure, "duplex", frame.duplex)
    _draw_bar(figure, 1.0, style.HAIRLINE)


def _draw_progress(figure: Figure, s: Snapshot) -> None:
    """What changes in the header: facts, and how much of the episode is over."""
    _write_fact(figure, "slot", f"{number_text(s.slot)} / {number_text(s.num_slots)}")
    _write_fact(figure, "mean AoI, slots", number_text(s.mean_age, 1))
    _write_fact(figure, "Jain's index", f"{s.jain:.2f}")
    _write_fact(figure, "harvested", total_energy_text(s.total_harvested_j))
    _draw_bar(figure, min(s.slot / max(s.num_slots, 1), 1.0), style.DATA)


def _write_fact(figure: Figure, name: str, value: str) -> None:
    _write(figure, _FACTS[name], 33, value, fontsize=11.5, fontweight="bold")


def _draw_bar(figure: Figure, share: float, colour: str) -> None:
    from matplotlib.patches import Rectangle

    corner = (18 / style.WIDTH_PX, 1 - 49 / style.HEIGHT_PX)
    size = (share * (1 - 36 / style.WIDTH_PX), 3 / style.HEIGHT_PX)
    figure.add_artist(Rectangle(corner, *size, color=colour, linewidth=0))


def _draw_colourbar(figure: Figure, top: float) -> None:
    panel = Panel(figure, style.COLOURBAR, across=(0, 1), along=(1, top))
    panel.fill(list(_age_colours()))
    panel.number_along(_ticks(1, top), right=True)
    panel.write_right("Age of Information in slots")


def _ticks(low: float, high: float) -> list[float]:
    """Both ends, and round numbers between them as far as they leave them room."""
    step = round_step((high - low) / 6)
    between = np.arange(step, high, step)
    return [low, *between[(between >= low + step / 2) & (between <= high - step / 2)], high]


class _Bars:
    """A bar for each node; what passes the top ends there, with an arrow.

    Args:
        figure: what to draw on.
        box: where, in px.
        count: how many nodes there are.
        top: the upper end of the axis.
    """

    def __init__(self, figure: Figure, box: style.Box, count: int, top: float) -> None:
        self._count, self._top, self._height_px = count, top, box[3]
        places = max(count, 3)
        middle = (count + 1) / 2
        self._node_px = box[2] / places
        self._width_pt = 0.68 * style.PT_PER_PX * min(self._node_px, 44)
        self.panel = Panel(
            figure,
            box,
            across=(middle - places / 2, middle + places / 2),
            along=(0, _HEADROOM * top),
        )

    def draw_axes(self) -> None:
        """Numbers of nodes, and lines with theirs."""
        # As many numbers as there is room for, according to their digits.
        every = round_step(self._count * len(str(self._count)) / 40)
        heights = [0, self._top / 2, self._top]
        self.panel.number_across(range(every, self._count + 1, every))
        self.panel.number_along(heights)
        self.panel.draw_across(heights, colors=style.HAIRLINE, linewidths=0.8)

    def draw(self, values: Floats, colours: Any, labels: list[str]) -> None:
        """The bars, with as many numbers as there is room for."""
        nodes, heights = np.arange(1, self._count + 1), np.minimum(values, self._top)
        # Thick lines: a thousand of them are drawn as quickly as a few bars.
        self.panel.draw_segments(
            [[(node, 0), (node, height)] for node, height in zip(nodes, heights, strict=True)],
            colors=colours,
            linewidths=self._width_pt,
            capstyle="butt",
            zorder=1,
        )
        if self._count > _MOST_VALUES:
            return
        px = _HEADROOM * self._top / self._height_px
        shown = [x + ("↑" if v > self._top else "") for x, v in zip(labels, values, strict=True)]
        # Neighbours do not touch: a digit is 0.64 em wide, the arrow 0.84.
        widest_em = max(0.64 * len(text) + 0.2 * text.endswith("↑") for text in shown)
        room_pt = (self._node_px - 6) * style.PT_PER_PX
        size_pt = max(min(7.0, room_pt / widest_em), 5.0)
        for node, height, label in zip(nodes.tolist(), heights, shown, strict=True):
            self.panel.write(
                node,
                height + 3 * px,
                label,
                fontsize=size_pt,
                va="bottom",
                zorder=3,
                bbox={"boxstyle": "square,pad=0", "fc": "white", "ec": "none", "alpha": 0.85},
            )


def _draw_legend(figure: Figure, frame: _Frame) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patheffects import withStroke
    from matplotlib.textpath import TextPath
    from matplotlib.transforms import Affine2D

    def line(label: str, **options: Any) -> Line2D:
        return Line2D([], [], label=label, **options)

    ring = f"ring: energy stored, closed at {energy_text(frame.yardstick_j)}"
    handles = [
        line("AUV at depth z", color="none", marker=hull_path(), ms=22, mfc=style.AUV, mec="none"),
        line("charging", color=style.ENERGY, alpha=0.45, lw=6.5),
        line("packet delivered", color=style.DATA, lw=1.6, marker=">", ms=6),
        line("no packet", color=style.FAILED, lw=1.6, ls=(0, (4, 2.5)), marker="X", ms=7),
        line(ring, color="none", marker="o", ms=10, mfc="white", mec=style.ENERGY, mew=2.5),
    ]
    dots = {"lw": 1.5, "ls": style.COURSE, "marker": "o", "markevery": [1], "mfc": "none"}
    frame_of_bar = withStroke(linewidth=5.5, foreground=style.INK)
    letter = TextPath((0, 0), style.ASLEEP)
    moon = letter.transformed(
        Affine2D().translate(*-letter.get_extents().get_points().mean(axis=0))
    )
    block = {"marker": "s", "mec": style.INK}
    more = {
        line("battery", color=style.ENERGY, lw=4, path_effects=[frame_of_bar]): frame.has_battery,
        line("under way to", color=style.AUV, ms=6, **dots): frame.takes_slots,
        line("dock", color="none", ms=10, mfc=style.DOCK, **block): frame.has_docks,
        line("asleep", color="none", marker=moon, ms=9, mfc=style.INK): frame.can_sleep,
    }
    handles += [handle for handle, is_shown in more.items() if is_shown]
    figure.legend(
        handles=handles,
        loc="lower left",
        bbox_to_anchor=(0.012, 0.005),
        ncols=len(handles) if len(handles) <= _LEGENDS_A_ROW else -(-len(handles) // 2),
        frameon=False,
        fontsize=8,
        labelcolor=style.INK,
        handlelength=2.6,
        columnspacing=2.2,
    )
