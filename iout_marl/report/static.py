"""Figures as PNG and SVG, by matplotlib. The same data give the same bytes."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from rich.cells import cell_len

from iout_marl.render import style
from iout_marl.render.settings import drawing
from iout_marl.report import palette
from iout_marl.report.content import Figure, Plot, Trajectory
from iout_marl.report.markup import plain_text
from iout_marl.report.series import (
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

if TYPE_CHECKING:
    import matplotlib.figure

_DPI = 160
_WIDTH_IN = 7.4
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
    if isinstance(figure, Trajectory):
        return ""
    titles = title_lines(figure.x_label) + title_lines(figure.y_label)
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
        if plot.kind == "bars":
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

    if plot.kind == "bars":
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

    axes.set_xlabel("\n".join(title_lines(plot.x_label)).translate(replaced))
    axes.set_ylabel("\n".join(title_lines(plot.y_label)).translate(replaced))
    axes.grid(axis="y" if plot.categories else "both")
    axes.spines[["top", "right"]].set_visible(False)
    # Before the scales, which look for data where no limits are set.
    for limits, set_limits in ((x_limits(plot), axes.set_xlim), (y_limits(plot), axes.set_ylim)):
        if limits is not None:
            set_limits(*limits)
    for axis, logarithmic in (("x", is_log_x(plot)), ("y", plot.log_y)):
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
    if plot.at_places:  # after the scale, which has ticks of its own
        axes.set_xticks(*ticks(plot))
        axes.xaxis.set_minor_locator(NullLocator())


def _draw_trajectory(trajectory: Trajectory) -> matplotlib.figure.Figure:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LinearSegmentedColormap, Normalize
    from matplotlib.figure import Figure as Canvas
    from matplotlib.lines import Line2D
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    canvas = Canvas(figsize=(_WIDTH_IN, 4.9), facecolor="white")
    axes: Any = canvas.add_axes((-0.02, 0.07, 0.9, 0.95), projection="3d")
    slots = max(len(trajectory.path) - 1, 1)
    colours = LinearSegmentedColormap.from_list("slots", palette.SLOTS)
    shade = ScalarMappable(Normalize(0, slots), colours)

    path = trajectory.path
    steps = [path[i : i + 2] for i in range(len(path) - 1)]
    if steps:
        shades = colours([i / slots for i in range(len(steps))])
        axes.add_collection3d(Line3DCollection(steps, colors=shades, linewidths=1.8))
    for chosen, colour in (
        (trajectory.charged, palette.CHARGED),
        (trajectory.heard, palette.HEARD),
    ):
        pairs = zip(path[1:], chosen, strict=True)
        links = [(cell, trajectory.nodes[node - 1]) for cell, node in pairs if node]
        if links:
            thin = Line3DCollection(links, colors=colour, linewidths=0.6, alpha=0.35)
            axes.add_collection3d(thin)
    marks = {"depthshade": False, "zorder": 5}
    done = [
        (cell, ok)
        for cell, heard, ok in zip(path[1:], trajectory.heard, trajectory.delivered, strict=True)
        if heard
    ]
    for ok, label, mark, colour, size in (
        (True, "packet delivered", "o", palette.HEARD, 26),
        (False, "packet lost", "x", palette.FAILED, 34),
    ):
        cells = [cell for cell, arrived in done if arrived == ok]
        if cells:
            axes.scatter(
                *zip(*cells, strict=True), marker=mark, c=colour, s=size, label=label, **marks
            )
    # Open marks, since an episode often starts or ends at a node.
    for cell, label, mark in ((path[0], "start", "o"), (path[-1], "end", "s")):
        look = {"facecolor": "none", "edgecolor": style.INK, "linewidth": 1.3}
        axes.scatter(*cell, marker=mark, s=150, label=label, **look, **marks)
    if trajectory.nodes:
        nodes = zip(*trajectory.nodes, strict=True)
        axes.scatter(*nodes, marker="D", s=55, c=palette.NODE, label="node", **marks)
    for number, (x, y, z) in enumerate(trajectory.nodes, start=1):
        axes.text(x, y, z - 0.3, f" {number}", fontsize=10, fontweight="bold", zorder=6)

    _set_space(axes, trajectory)
    bar = canvas.colorbar(shade, cax=canvas.add_axes((0.9, 0.27, 0.018, 0.5)))
    bar.set_label("slot")
    bar.outline.set_visible(False)
    handles, labels = axes.get_legend_handles_labels()
    for colour, label in ((palette.CHARGED, "charges"), (palette.HEARD, "hears")):
        handles.append(Line2D([], [], color=colour, linewidth=1.2))
        labels.append(label)
    canvas.legend(handles, labels, loc="lower center", ncols=7, frameon=False, fontsize=8.5)
    return canvas


def _set_space(axes: Any, trajectory: Trajectory) -> None:
    from matplotlib.ticker import MaxNLocator

    size = trajectory.grid
    for axis, cells in zip("xyz", size, strict=True):
        ends = (0.5, cells + 0.5) if axis != "z" else (cells + 0.5, 0.5)  # z is the depth
        getattr(axes, f"set_{axis}lim")(*ends)
        label = f"{'depth ' if axis == 'z' else ''}{axis}"
        getattr(axes, f"set_{axis}label")(f"{label}, cells of {trajectory.spacing_m:g} m")
        ruler = getattr(axes, f"{axis}axis")
        ruler.set_major_locator(MaxNLocator(integer=True, nbins=6))
        ruler.pane.set_facecolor("#f6f8fa")
        ruler.pane.set_edgecolor(style.HAIRLINE)
    axes.set_box_aspect([max(n / max(size), 0.45) for n in size], zoom=1.12)
    axes.view_init(elev=24, azim=-58)
