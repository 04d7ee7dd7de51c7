"""A trajectory in three dimensions, as Plotly draws it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeAlias

from iout_marl.report import palette
from iout_marl.report.content import Trajectory

Cell: TypeAlias = tuple[int, int, int]
#: From a cell of the AUV to that of a node.
Links: TypeAlias = set[tuple[Cell, Cell]]

_MOST_VISITS = 5  # of a cell, told when it is pointed at
_MOST_AGES = 10
_TOLD = "%{text}<extra></extra>"
_SCALE = [[i / (len(palette.SLOTS) - 1), shade] for i, shade in enumerate(palette.SLOTS)]


def draw_space(trajectory: Trajectory) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Data and layout: the path, coloured by slot, nodes, and who was charged and heard."""
    told = _visits(trajectory)
    cells, nodes = trajectory.path[1:], trajectory.nodes
    charged: Links = {
        (cell, nodes[node - 1])
        for cell, node in zip(cells, trajectory.charged, strict=True)
        if node
    }
    heard: dict[bool, Links] = {True: set(), False: set()}
    for cell, node, arrived in zip(cells, trajectory.heard, trajectory.delivered, strict=True):
        if node:
            heard[arrived].add((cell, nodes[node - 1]))
    # Plotly's cross in space is a letter that few fonts have.
    lost = "diamond-open"
    data = [
        _path(trajectory),
        _cells(trajectory, told),
        _links("charged", charged, {"color": palette.CHARGED, "width": 7}, 0.45),
        _marked_links("heard, packet delivered", heard[True], told, palette.HEARD, "circle"),
        _marked_links("heard, packet lost", heard[False], told, palette.FAILED, lost),
        _nodes(trajectory),
        *_ends(trajectory),
    ]
    return [trace for trace in data if trace["x"]], _layout(trajectory)


def _visits(trajectory: Trajectory) -> dict[Cell, str]:
    """What is told of a cell of the path when it is pointed at: the visits to it."""
    visits: dict[Cell, list[str]] = {trajectory.path[0]: ["start"]}
    slots = zip(
        trajectory.path[1:],
        trajectory.charged,
        trajectory.heard,
        trajectory.delivered,
        trajectory.ages,
        strict=True,
    )
    for slot, (cell, charged, heard, delivered, ages) in enumerate(slots, start=1):
        did = [f"charges node {charged}"] if charged else []
        if heard:
            did.append(f"hears node {heard}: packet {'delivered' if delivered else 'lost'}")
        shown = " ".join(map(str, ages[:_MOST_AGES])) + (" …" if len(ages) > _MOST_AGES else "")
        text = f"<b>slot {slot}</b>: {', '.join(did) or 'idle'}<br>   ages {shown}"
        visits.setdefault(cell, []).append(text)
    told = {}
    for cell, lines in visits.items():
        more = len(lines) - _MOST_VISITS
        rest = [f"and {more} more slots here"] if more > 0 else []
        told[cell] = "<br>".join(
            [f"cell {cell[0]}, {cell[1]}, {cell[2]}", *lines[:_MOST_VISITS], *rest]
        )
    return told


def _along(cells: Iterable[Cell | None]) -> dict[str, list[int | None]]:
    """Coordinates of cells; None is a gap."""
    places = list(cells)
    return {
        axis: [None if cell is None else cell[i] for cell in places] for i, axis in enumerate("xyz")
    }


def _path(trajectory: Trajectory) -> dict[str, Any]:
    slots = len(trajectory.path) - 1
    return {
        "type": "scatter3d",
        "mode": "lines",
        "name": "path",
        "showlegend": False,  # a legend's entry cannot have many colours
        **_along(trajectory.path),
        "line": {
            "color": list(range(slots + 1)),
            "colorscale": _SCALE,
            "width": 6,
            "showscale": True,
            "colorbar": {
                "title": {"text": "slot"},
                "thickness": 10,
                "len": 0.6,
                "x": 1,
                "xpad": 4,
                "outlinewidth": 0,
            },
        },
        "legendgroup": "path",
        "hoverinfo": "skip",
    }


def _cells(trajectory: Trajectory, told: dict[Cell, str]) -> dict[str, Any]:
    """A small mark on every cell of the path, in the colour of the last visit."""
    last = {cell: slot for slot, cell in enumerate(trajectory.path)}
    return {
        "type": "scatter3d",
        "mode": "markers",
        "name": "path of the AUV",
        **_along(told),
        "marker": {
            "size": 3,
            "color": [last[cell] for cell in told],
            "cmin": 0,
            "cmax": len(trajectory.path) - 1,
            "colorscale": _SCALE,
        },
        "legendgroup": "path",
        "text": list(told.values()),
        "hovertemplate": _TOLD,
    }


def _links(name: str, links: Links, line: dict[str, Any], opacity: float) -> dict[str, Any]:
    """Lines from the AUV to nodes, each once."""
    return {
        "type": "scatter3d",
        "mode": "lines",
        "name": name,
        **_along(place for cell, node in sorted(links) for place in (cell, node, None)),
        "line": line,
        "opacity": opacity,
        "hoverinfo": "skip",
    }


def _marked_links(
    name: str, links: Links, told: dict[Cell, str], colour: str, mark: str
) -> dict[str, Any]:
    """The same with a mark at the AUV; lost packets are told by mark and dashes."""
    dash = "solid" if mark == "circle" else "dash"
    return _links(name, links, {"color": colour, "width": 4, "dash": dash}, 1.0) | {
        "mode": "lines+markers",
        # Neither the nodes' ends nor the gaps have one.
        "marker": {
            "symbol": mark,
            "size": [8 if mark == "circle" else 11, 0, 0] * len(links),
            "color": colour,
            "opacity": 1,
            "line": {"width": 0},
        },
        # Whichever mark is in front there, that or that of the path, it tells the same.
        "text": [told[cell] for cell, _ in sorted(links) for _ in range(3)],
        "hoverinfo": None,
        "hovertemplate": _TOLD,
    }


def _nodes(trajectory: Trajectory) -> dict[str, Any]:
    charged = [trajectory.charged.count(n) for n in range(1, len(trajectory.nodes) + 1)]
    packets = list(zip(trajectory.heard, trajectory.delivered, strict=True))
    texts = []
    for number, cell in enumerate(trajectory.nodes, start=1):
        arrived, lost = packets.count((number, True)), packets.count((number, False))
        texts.append(
            f"<b>node {number}</b><br>cell {cell[0]}, {cell[1]}, {cell[2]}"
            f"<br>charged in {charged[number - 1]} slots"
            f"<br>packets: {arrived} delivered, {lost} lost"
        )
    return {
        "type": "scatter3d",
        "mode": "markers+text",
        "name": "nodes",
        **_along(trajectory.nodes),
        "text": [str(number) for number in range(1, len(trajectory.nodes) + 1)],
        "textposition": "top center",
        "textfont": {"size": 15},
        "marker": {"symbol": "diamond", "size": 7, "color": palette.NODE},
        "hovertext": texts,
        "hovertemplate": "%{hovertext}<extra></extra>",
    }


def _ends(trajectory: Trajectory) -> list[dict[str, Any]]:
    return [
        {
            "type": "scatter3d",
            "mode": "markers",
            "name": name,
            **_along([cell]),
            "marker": {"symbol": mark, "size": 10, "color": palette.colour(4)},
            "hoverinfo": "skip",
        }
        for name, cell, mark in (
            ("start", trajectory.path[0], "circle-open"),
            ("end", trajectory.path[-1], "square-open"),
        )
    ]


def _layout(trajectory: Trajectory) -> dict[str, Any]:
    size = trajectory.grid
    scene: dict[str, Any] = {
        "aspectmode": "manual",
        # A flat grid keeps some depth.
        "aspectratio": {
            axis: max(cells / max(size), 0.4) for axis, cells in zip("xyz", size, strict=True)
        },
        "camera": {"eye": {"x": 1.0, "y": -1.25, "z": 0.7}, "center": {"x": 0, "y": 0, "z": -0.2}},
    }
    for axis, cells in zip("xyz", size, strict=True):
        ends = [0.5, cells + 0.5]
        scene[f"{axis}axis"] = {
            "title": {"text": "depth z" if axis == "z" else axis},
            "range": ends[::-1] if axis == "z" else ends,
            "tickmode": "linear",
            "tick0": 1,
            "dtick": max(1, cells // 5),
            "zeroline": False,
            "showbackground": False,
            "showspikes": False,
        }
    return {"scene": scene, "margin": {"l": 0, "r": 0, "t": 0, "b": 0}}
