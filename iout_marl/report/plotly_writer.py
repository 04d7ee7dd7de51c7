"""Figures as Plotly draws them in a page: data and layout, as JSON.

Colours of fonts and grids are left out: the page sets them, according to its theme.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from iout_marl.files import to_json
from iout_marl.report import palette
from iout_marl.report.figure import Figure, Plot
from iout_marl.report.markup import plotly_template, plotly_text
from iout_marl.report.plot_layout import (
    LONGEST_NAME,
    Series,
    is_drawn,
    is_log_x,
    lay_out,
    name_lines,
    ticks,
    title_lines,
    x_limits,
    y_limits,
)
from iout_marl.report.trajectory_3d import draw_trajectory

_LEGEND = {
    "orientation": "h",
    "yref": "container",
    "y": 0,
    "yanchor": "bottom",
    "x": 0,
    "xanchor": "left",
    "itemsizing": "constant",
}


def plotly_json(figure: Figure) -> str:
    """A figure for `Plotly.newPlot`: an object with `data` and `layout`."""
    data, layout = _draw_plot(figure) if isinstance(figure, Plot) else draw_trajectory(figure)
    common = {
        "template": {},  # else several kB of defaults
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "autosize": True,
        "showlegend": True,
        "legend": _LEGEND,
        "hovermode": "closest",
        "font": {"family": "system-ui, sans-serif", "size": 13},
        "hoverlabel": {"align": "left"},
    }
    return to_json(_without_nan({"data": data, "layout": common | layout}))


def _without_nan(part: Any) -> Any:
    """The same with null for what is no number, which Plotly leaves out."""
    if isinstance(part, dict):
        return {key: _without_nan(value) for key, value in part.items()}
    if isinstance(part, list | tuple):
        return [_without_nan(value) for value in part]
    return None if isinstance(part, float) and not math.isfinite(part) else part


def _draw_plot(plot: Plot) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    series = lay_out(plot)
    data = [_band(one) for one in series if one.band and one.spans()]
    data += [_bars(plot, one) if plot.x.is_categorical else _line(plot, one) for one in series]
    return data, {
        "xaxis": _x_axis(plot),
        "yaxis": _y_axis(plot),
        "margin": {"l": 56, "r": 12, "t": 28, "b": 44},
        "barmode": "overlay",  # the places of bars have been worked out already
    }


def _axis(title: str, limits: tuple[float, float] | None) -> dict[str, Any]:
    axis: dict[str, Any] = {
        "title": {"text": "<br>".join(map(plotly_text, title_lines(title))), "standoff": 10},
        "automargin": True,
        "zeroline": False,
        "showline": True,
        "ticks": "outside",
        "ticklen": 4,
    }
    if limits is not None:
        axis["range"] = list(limits)
    return axis


def _log_axis(
    title: str, limits: tuple[float, float] | None, values: Iterable[float]
) -> dict[str, Any]:
    axis = _axis(title, None) | {"type": "log", "exponentformat": "power"}
    if limits is not None:
        axis["range"] = [math.log10(end) for end in limits]
    exponents = axis.get("range") or [math.log10(value) for value in values if is_drawn(value)]
    decades = max(exponents, default=0.0) - min(exponents, default=0.0)
    if decades > 2:  # below that, Plotly labels steps within a decade, too
        axis["dtick"] = math.ceil(decades / 8)
    return axis


def _y_axis(plot: Plot) -> dict[str, Any]:
    if plot.y.is_log:
        values = (y for line in plot.lines for y in line.y)
        return _log_axis(plot.y.label, y_limits(plot), values)
    return _axis(plot.y.label, y_limits(plot))


def _x_axis(plot: Plot) -> dict[str, Any]:
    if is_log_x(plot):
        values = (x for line in plot.lines for x in line.x)
        axis = _log_axis(plot.x.label, x_limits(plot), values)
    else:
        axis = _axis(plot.x.label, x_limits(plot))
    if not plot.x.has_single_values:
        return axis
    places, labels = ticks(plot)
    ruler = {"tickmode": "array", "tickvals": places, "ticktext": labels}
    axis.pop("dtick", None)
    return axis | ruler | {"showgrid": not plot.x.is_categorical}


def _entry(series: Series) -> dict[str, Any]:
    name = "<br>".join(map(plotly_text, name_lines(series.line.name)))
    # By its own name: two that are cut short alike are two.
    return {"name": name, "legendgroup": series.group, "showlegend": series.in_legend}


def _hover(plot: Plot, series: Series) -> dict[str, Any]:
    line = series.line
    points = []
    for i, (x, y) in enumerate(zip(line.x, line.y, strict=True)):
        text = f"{y:.4g}"
        if line.low and not math.isnan(line.low[i]):
            text += f"  [{line.low[i]:.4g}, {line.high[i]:.4g}]"
        points.append([plot.x.text(x) if plot.x.has_single_values else f"{x:g}", text])
    name, across, along = (
        plotly_template(text, LONGEST_NAME) for text in (line.name, plot.x.label, plot.y.label)
    )
    template = (
        f"<b>{name}</b><br>{across}: %{{customdata[0]}}<br>{along}: %{{customdata[1]}}"
        "<extra></extra>"
    )
    return {"customdata": points, "hovertemplate": template}


def _line(plot: Plot, series: Series) -> dict[str, Any]:
    trace: dict[str, Any] = {
        "type": "scatter",
        "mode": "lines+markers" if series.line.joined else "markers",
        "x": series.x,
        "y": series.y,
        "line": {
            "color": series.look.colour,
            "width": 2,
            "dash": _dash(series),
        },
        "marker": {
            "color": series.look.colour,
            "symbol": series.look.mark[1],
            "size": 7,
            "maxdisplayed": 9 if series.band else 0,
        },
        **_entry(series),
        **_hover(plot, series),
    }
    if not series.band and series.spans():
        trace["error_y"] = _error_bars(series) | {"color": series.look.colour}
    return trace


def _dash(series: Series) -> str:
    if series.line.dashed:
        return "dash"
    return ",".join(f"{px}px" for px in series.look.dash) or "solid"


def _bars(plot: Plot, series: Series) -> dict[str, Any]:
    trace: dict[str, Any] = {
        "type": "bar",
        "x": series.x,
        "y": series.y,
        "width": series.width,
        "marker": {"color": series.look.colour},
        **_entry(series),
        **_hover(plot, series),
    }
    if series.look.hatch[1]:
        _, shape, size = series.look.hatch
        # As white as in the pictures, also on a dark page.
        pattern = {"shape": shape, "size": size, "solidity": 0.3, "fgcolor": "#ffffff"}
        trace["marker"]["pattern"] = {**pattern, "fillmode": "overlay"}
    if series.spans():
        trace["error_y"] = _error_bars(series)  # the page sets its colour
    return trace


def _error_bars(series: Series) -> dict[str, Any]:
    points = list(zip(series.y, series.low, series.high, strict=True))
    return {
        "type": "data",
        "symmetric": False,
        "array": [_length(high - y) for y, _, high in points],
        "arrayminus": [_length(y - low) for y, low, _ in points],
        "thickness": 1.4,
        "width": 4,
    }


def _length(length: float) -> float | str:
    # Plotly takes a missing number for 0 and draws a cap there; for a word it draws nothing.
    return "none" if math.isnan(length) else length


def _band(series: Series) -> dict[str, Any]:
    """One outline for every run of intervals, with gaps between them."""
    x: list[float | None] = []
    y: list[float | None] = []
    for span in series.spans():
        if x:
            x.append(None)
            y.append(None)
        x += [series.x[i] for i in (*span, *reversed(span))]
        y += [series.high[i] for i in span] + [series.low[i] for i in reversed(span)]
    return {
        "type": "scatter",
        "mode": "lines",
        "x": x,
        "y": y,
        "fill": "toself",
        "fillcolor": palette.translucent(series.look.colour, 0.18),
        "line": {"width": 0, "color": series.look.colour},
        "hoverinfo": "skip",
        **_entry(series),
        "showlegend": False,
    }
