"""Figures as PNG and SVG, by matplotlib. The same data give the same bytes."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.cells import cell_len

from iout_marl.render import style
from iout_marl.render.hull import hull_path
from iout_marl.render.labels import auv_name
from iout_marl.render.panel import Panel
from iout_marl.render.projection import FROM_ABOVE, FROM_THE_SIDE, Projection
from iout_marl.render.scene import Passed, Scene
from iout_marl.render.settings import drawing
from iout_marl.report.figure import Figure, Plot, TrajectoryPlot
from iout_marl.report.markup import plain_text
from iout_marl.report.plot_layout import (
    LONGEST_NAME,
    Series,
    is_log_x,
    lay_out,
    legend,
    ticks,
    title_lines,
    x_limits,
    y_limits,
)
from iout_marl.scenario.spacing import spacing_text

if TYPE_CHECKING:
    import matplotlib.figure

_DPI = 160
_WIDTH_IN = 7.4
#: A trajectory's picture: the map from above, the view from the side, the colours of slots.
_MAP: style.Box = (44, 44, 360, 360)
_SLOTS: style.Box = (416, 44, 8, 360)
_PROFILE: style.Box = (500, 210, 224, 194)
_MOST_AUVS = 5  # that have an entry in the legend
_OPTIONS: Any = {
    "svg.hashsalt": "iout",  # else identifiers in the SVG are drawn by lot
    "svg.fonttype": "path",
    "font.size": 9,
    "text.color": style.INK,
    "axes.labelcolor": style.INK,
    "axes.edgecolor": style.MUTED,
    "axes.linewidth": 0.8,
    "axes.axisbelow": True,
    "xtick.color": style.MUTED,
    "ytick.color": style.MUTED,
    "xtick.labelcolor": style.INK,
    "ytick.labelcolor": style.INK,
    "grid.color": style.HAIRLINE,
    "grid.linewidth": 0.7,
}


def draw(figure: Figure) -> dict[str, bytes]:
    """A figure as files: `png` and `svg`."""
    with drawing(_words(figure), _OPTIONS) as replaced:
        # Without pyplot, no figure needs closing.
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.backends.backend_svg import FigureCanvasSVG

        if isinstance(figure, Plot):
            drawn = _draw_plot(figure, replaced)
        else:
            drawn = _draw_trajectory(figure)
        png, svg = io.BytesIO(), io.BytesIO()
        FigureCanvasAgg(drawn).print_figure(png, format="png", dpi=_DPI)
        FigureCanvasSVG(drawn).print_figure(svg, format="svg", metadata={"Date": None})
    return {"png": png.getvalue(), "svg": svg.getvalue()}


def _words(figure: Figure) -> str:
    """All that a user has named and that is drawn."""
    if isinstance(figure, TrajectoryPlot):
        return ""
    titles = title_lines(figure.x.label) + title_lines(figure.y.label)
    names = (plain_text(figure.lines[i].name, LONGEST_NAME) for i in legend(figure))
    return "".join([*titles, *names])


def _draw_plot(plot: Plot, replaced: Mapping[int, str]) -> matplotlib.figure.Figure:
    from matplotlib.figure import Figure as Canvas

    series = lay_out(plot)
    entries = [
        (_legend_entry(plot, one), plain_text(one.line.name, LONGEST_NAME).translate(replaced))
        for one in series
        if one.in_legend
    ]
    columns = _legend_columns([name for _, name in entries])
    rows = math.ceil(len(entries) / columns)
    canvas = Canvas(figsize=(_WIDTH_IN, 3.9 + 0.2 * rows), layout="constrained", facecolor="white")
    axes: Any = canvas.add_subplot()
    for one in series:
        if plot.x.is_categorical:
            _draw_bars(axes, one)
        else:
            _draw_line(axes, one)
    _set_axes(axes, plot, replaced)
    if entries:
        drawn = canvas.legend(
            handles=[handle for handle, _ in entries],
            labels=["x"] * len(entries),
            loc="outside lower center",
            ncols=columns,
            frameon=False,
            fontsize=8.5,
            handlelength=2.8,
        )
        # Afterwards: labels that begin with `_` would be left out.
        for text, (_, name) in zip(drawn.get_texts(), entries, strict=True):
            text.set_text(name)
    return canvas


def _legend_columns(entries: list[str]) -> int:
    longest = max(map(cell_len, entries), default=0)
    return max(1, min(len(entries), 100 // (longest + 8)))


def _legend_entry(plot: Plot, series: Series) -> Any:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    if plot.x.is_categorical:
        return Patch(**_bar_look(series))
    look = series.look
    return Line2D(
        [], [], color=look.colour, linestyle=_line_style(series), marker=look.mark[0], ms=4
    )


def _line_style(series: Series) -> Any:
    if not series.line.joined:
        return "none"
    # matplotlib counts in widths of the line, which is of 2 px.
    return (0, [px / 2 for px in series.look.dash]) if series.look.dash else "-"


def _draw_line(axes: Any, series: Series) -> None:
    axes.plot(
        series.x,
        series.y,
        color=series.look.colour,
        linestyle=_line_style(series),
        linewidth=1.5,
        marker=series.look.mark[0],
        markersize=4,
        markevery=max(len(series.x) // 8, 1) if series.band else 1,
        zorder=3,
    )
    for span in series.spans():
        low, high = ([values[i] for i in span] for values in (series.low, series.high))
        x = [series.x[i] for i in span]
        if series.band and len(span) > 1:
            axes.fill_between(x, low, high, color=series.look.colour, alpha=0.18, linewidth=0)
        else:
            _draw_error_bars(axes, series, span, series.look.colour)


def _draw_error_bars(axes: Any, series: Series, span: list[int], colour: str) -> None:
    # Bars from end to end: an interval need not hold its point.
    for i in span:
        ends = ([series.x[i]] * 2, [series.low[i], series.high[i]])
        axes.plot(*ends, color=colour, linewidth=1.1, marker="_", markersize=5, zorder=4)


def _draw_bars(axes: Any, series: Series) -> None:
    heights = [0.0 if math.isnan(y) else y for y in series.y]
    axes.bar(series.x, heights, width=series.width, zorder=2, **_bar_look(series))
    for span in series.spans():
        _draw_error_bars(axes, series, span, style.INK)


def _bar_look(series: Series) -> dict[str, Any]:
    hatch = {"hatch": series.look.hatch[0], "edgecolor": "white"} if series.look.hatch[0] else {}
    return {"facecolor": series.look.colour, "linewidth": 0, **hatch}


def _set_axes(axes: Any, plot: Plot, replaced: Mapping[int, str]) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

    axes.set_xlabel("\n".join(title_lines(plot.x.label)).translate(replaced))
    axes.set_ylabel("\n".join(title_lines(plot.y.label)).translate(replaced))
    axes.grid(axis="y" if plot.x.is_categorical else "both")
    axes.spines[["top", "right"]].set_visible(False)
    # Before the scales, which look for data where no limits are set.
    for limits, set_limits in ((x_limits(plot), axes.set_xlim), (y_limits(plot), axes.set_ylim)):
        if limits is not None:
            set_limits(*limits)
    for axis, logarithmic in (("x", is_log_x(plot)), ("y", plot.y.is_log)):
        if not logarithmic:
            continue
        getattr(axes, f"set_{axis}scale")("log", nonpositive="clip")
        ends = getattr(axes, f"get_{axis}lim")()
        few = math.log10(ends[1]) - math.log10(ends[0]) < 2
        ruler = getattr(axes, f"{axis}axis")
        ruler.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,)))
        # matplotlib's own powers of ten are formulas.
        ruler.set_major_formatter(FuncFormatter(lambda value, _place: f"{value:g}"))
        ruler.set_minor_formatter(NullFormatter())
    if plot.x.has_single_values:  # after the scale, which has ticks of its own
        axes.set_xticks(*ticks(plot))
        axes.xaxis.set_minor_locator(NullLocator())


def _draw_trajectory(trajectory: TrajectoryPlot) -> matplotlib.figure.Figure:
    """From above and from the side; below the latter, what is what."""
    from matplotlib.figure import Figure as Canvas

    scene = trajectory.scene()
    canvas = Canvas(figsize=(_WIDTH_IN, 4.4), dpi=style.DPI, facecolor="white")
    cells = f", in cells of {spacing_text(trajectory.episode.spacing_m)}"
    colours = np.tile(style.rgba(style.NODE), (len(scene.nodes), 1))
    for view, box, title in (
        (FROM_ABOVE, _MAP, f"From above{cells}"),
        (FROM_THE_SIDE, _PROFILE, "From the side"),
    ):
        projection = Projection(canvas, view, scene.grid_shape, box, scene.edges_m)
        # No room for both, where a stretched axis is named beside.
        is_downwards = view is FROM_THE_SIDE and not projection.stretched
        projection.draw_grid(title + (", z downwards" if is_downwards else ""))
        projection.draw(scene, colours)
    if scene.num_auvs == 1:
        slots = len(scene.path) - 1
        panel = Panel(canvas, _SLOTS, across=(0, 1), along=(0, slots))
        panel.fill(list(style.slot_colours(128)))
        panel.number_along([0, slots], right=True)
        panel.write_right("slot")
    canvas.legend(
        handles=_trajectory_entries(scene),
        loc="lower left",
        bbox_to_anchor=(_PROFILE[0] / style.DPI / _WIDTH_IN - 0.012, 0.02),
        ncols=2,
        frameon=False,
        fontsize=8.5,
    )
    return canvas


def _trajectory_entries(scene: Scene) -> list[Any]:
    from matplotlib.lines import Line2D

    def entry(label: str, **options: Any) -> Line2D:
        return Line2D([], [], label=label, **options)

    nose: dict[str, Any] = {"ls": "none", "marker": hull_path(), "ms": 18, "mec": "none"}
    ends = [("end", style.AUV)]
    if scene.num_auvs > 1:
        shown = range(min(scene.num_auvs, _MOST_AUVS))
        ends = [(f"AUV {auv_name(auv)}", style.auv_colour(auv)) for auv in shown]
    links = [
        entry(
            what.value,
            color=style.LINKS[what],
            lw=1.2,
            ls=style.DASHES[what],
            marker=style.MARKS.get(what, ""),
            ms=5,
            mew=0,
        )
        for what in Passed
    ]
    circle: dict[str, Any] = {"ls": "none", "marker": "o"}
    square: dict[str, Any] = {"ls": "none", "marker": "s", "mfc": style.DOCK, "mec": style.INK}
    return [
        *links,
        *([] if scene.docks is None else [entry("dock", ms=9, mew=1.2, **square)]),
        entry("node", mfc=style.NODE, mec=style.INK, ms=9, mew=0.5, **circle),
        entry("start", mfc="none", mec=style.INK, ms=9, mew=1.3, **circle),
        *(entry(label, mfc=colour, **nose) for label, colour in ends),
    ]
