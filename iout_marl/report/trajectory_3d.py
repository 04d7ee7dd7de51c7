"""A trajectory in three dimensions, as Plotly draws it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Any, TypeAlias

from iout_marl.render import style
from iout_marl.render.labels import auv_name
from iout_marl.render.scene import Link, Passed, Scene
from iout_marl.report import palette
from iout_marl.report.figure import TrajectoryPlot
from iout_marl.trajectory import Trajectory

Cell: TypeAlias = tuple[int, ...]

_MOST_VISITS = 5  # of a cell, listed when it is pointed at
_MOST_AGES = 10
_SCALE = [[i / (len(style.SLOTS) - 1), shade] for i, shade in enumerate(style.SLOTS)]
#: Plotly's cross in space is a letter that few fonts have.
_MARKS = {Passed.PACKET: ("circle", 8), Passed.LOSS: ("diamond-open", 11)}


def draw_trajectory(trajectory: TrajectoryPlot) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Data and layout: the paths, coloured by slot or AUV, nodes, and what passed."""
    scene = trajectory.scene()
    auvs = range(scene.num_auvs)
    visits = [_visits(trajectory.episode, auv) for auv in auvs]
    data: list[dict[str, Any]] = []
    for auv in auvs:
        data += [_path(scene, auv), _cells(scene, auv, visits[auv])]
    data += [_links(scene, what, visits) for what in Passed]
    data += [_nodes(trajectory.episode), _docks(scene), *_ends(scene)]
    return [trace for trace in data if trace["x"]], _layout(scene)


def _visits(episode: Trajectory, auv: int) -> dict[Cell, str]:
    """What pointing at a cell of a path shows: the visits to it."""
    path = [tuple(places[auv]) for places in episode.path]
    visits: dict[Cell, list[str]] = {path[0]: ["start"]}
    polled: dict[int, list[str]] = defaultdict(list)
    for slot, its_auv, node, packet in episode.polls():
        if its_auv == auv:
            polled[slot].append(f"{node}{'' if packet else ' (lost)'}")
    slots = zip(
        path[1:], episode.charged, episode.heard, episode.delivered, episode.ages, strict=True
    )
    for slot, (cell, charged, heard, delivered, ages) in enumerate(slots, start=1):
        did = [f"charges node {charged[auv]}"] if charged[auv] else []
        if heard[auv]:
            arrived = "delivered" if delivered[auv] else "lost"
            did.append(f"hears node {heard[auv]}: packet {arrived}")
        if polled[slot]:
            did.append(f"polls {' '.join(polled[slot])}")
        shown = " ".join(map(str, ages[:_MOST_AGES])) + (" …" if len(ages) > _MOST_AGES else "")
        text = f"<b>slot {slot}</b>: {', '.join(did) or 'idle'}<br>   ages {shown}"
        visits.setdefault(cell, []).append(text)
    whose = f"AUV {auv_name(auv)}, " if len(episode.path[0]) > 1 else ""
    texts = {}
    for cell, lines in visits.items():
        more = len(lines) - _MOST_VISITS
        rest = [f"and {more} more slots here"] if more > 0 else []
        where = f"{whose}cell {', '.join(map(str, cell))}"
        texts[cell] = "<br>".join([where, *lines[:_MOST_VISITS], *rest])
    return texts


def _trace(
    name: str, mode: str, cells: Iterable[Sequence[int] | None], **look: Any
) -> dict[str, Any]:
    """A trace through cells; None is a gap."""
    places = list(cells)
    coordinates = {
        axis: [None if cell is None else int(cell[i]) for cell in places]
        for i, axis in enumerate("xyz")
    }
    return {"type": "scatter3d", "name": name, "mode": mode, "hoverinfo": "skip"} | (
        coordinates | look
    )


def _pointed_at(texts: list[str]) -> dict[str, Any]:
    return {"text": texts, "hoverinfo": None, "hovertemplate": "%{text}<extra></extra>"}


def _path(scene: Scene, auv: int) -> dict[str, Any]:
    line: dict[str, Any] = {"width": 6, "color": style.auv_colour(auv)}
    if scene.num_auvs == 1:
        bar = {"title": {"text": "slot"}, "thickness": 10, "len": 0.6, "x": 1, "xpad": 4}
        line |= {"color": list(range(len(scene.path))), "colorscale": _SCALE, "showscale": True}
        line["colorbar"] = bar | {"outlinewidth": 0}
    # A legend's entry cannot have many colours.
    look = {"line": line, "legendgroup": f"path {auv}", "showlegend": False}
    return _trace("path", "lines", scene.path[:, auv], **look)


def _cells(scene: Scene, auv: int, visits: dict[Cell, str]) -> dict[str, Any]:
    """A small mark on every cell of a path, by slot in the colour of the last visit."""
    last = {tuple(cell): slot for slot, cell in enumerate(scene.path[:, auv].tolist())}
    marker: dict[str, Any] = {"size": 3, "color": style.auv_colour(auv)}
    if scene.num_auvs == 1:
        marker["color"] = [last[cell] for cell in visits]
        marker |= {"cmin": 0, "cmax": len(scene.path) - 1, "colorscale": _SCALE}
    name = "path of the AUV" if scene.num_auvs == 1 else f"path of AUV {auv_name(auv)}"
    look = {"marker": marker, "legendgroup": f"path {auv}"}
    return _trace(name, "markers", visits, **look, **_pointed_at(list(visits.values())))


def _links(scene: Scene, what: Passed, visits: Sequence[dict[Cell, str]]) -> dict[str, Any]:
    """Lines from AUVs to nodes, each once; packets have a mark at the AUV, lost ones dashes."""

    def ends(link: Link) -> tuple[int, Cell, Cell]:
        cell, node = scene.path[link.place, link.auv], scene.nodes[link.node]
        return link.auv, tuple(cell.tolist()), tuple(node.tolist())

    links = sorted({ends(link) for link in scene.earlier if link.what is what})
    cells = [place for _, cell, node in links for place in (cell, node, None)]
    colour = palette.LINKS[what]
    if what is Passed.CHARGE:
        return _trace(what.value, "lines", cells, line={"color": colour, "width": 7}, opacity=0.45)
    symbol, size = _MARKS[what]
    # Neither the nodes' ends nor the gaps have one.
    sizes = [size, 0, 0] * len(links)
    marker = {"symbol": symbol, "size": sizes, "color": colour, "opacity": 1, "line": {"width": 0}}
    line = {"color": colour, "width": 4, "dash": "dash" if what is Passed.LOSS else "solid"}
    # Whichever mark is in front there, that or that of the path, it shows the same.
    texts = [visits[auv][cell] for auv, cell, _ in links for _ in range(3)]
    look = {"line": line, "marker": marker, **_pointed_at(texts)}
    return _trace(what.value, "lines+markers", cells, **look)


def _nodes(episode: Trajectory) -> dict[str, Any]:
    charged = [node for slot in episode.charged for node in slot]
    heard = [node for slot in episode.heard for node in slot]
    arrived = [packet for slot in episode.delivered for packet in slot]
    packets = list(zip(heard, arrived, strict=True))
    packets += [(node, packet) for *_, node, packet in episode.polls()]
    numbers = range(1, len(episode.nodes) + 1)
    texts = [
        f"<b>node {number}</b><br>cell {', '.join(map(str, cell))}"
        f"<br>charged in {charged.count(number)} slots"
        f"<br>packets: {packets.count((number, True))} delivered, "
        f"{packets.count((number, False))} lost"
        for number, cell in zip(numbers, episode.nodes, strict=True)
    ]
    return _trace(
        "nodes",
        "markers+text",
        episode.nodes,
        text=[str(number) for number in numbers],
        textposition="top center",
        textfont={"size": 15},
        marker={"symbol": "diamond", "size": 7, "color": style.NODE},
        hoverinfo=None,
        hovertext=texts,
        hovertemplate="%{hovertext}<extra></extra>",
    )


def _docks(scene: Scene) -> dict[str, Any]:
    """A square at each; no trace where there are none."""
    marker = {"symbol": "square", "size": 14, "color": style.DOCK, "line": {"width": 1.5}}
    docks = () if scene.docks is None else scene.docks.tolist()
    return _trace("dock", "markers", docks, marker=marker, opacity=0.8)


def _ends(scene: Scene) -> list[dict[str, Any]]:
    marker = {"size": 10, "color": palette.colour(4)}
    return [
        _trace(name, "markers", cells, marker=marker | {"symbol": symbol})
        for name, cells, symbol in (
            ("start", scene.path[0], "circle-open"),
            ("end", scene.auvs, "square-open"),
        )
    ]


def _layout(scene: Scene) -> dict[str, Any]:
    size = scene.grid_shape
    sides_m = [cells * edge for cells, edge in zip(size, scene.edges_m, strict=True)]
    space: dict[str, Any] = {
        "aspectmode": "manual",
        # A flat grid keeps some depth.
        "aspectratio": {
            axis: max(side / max(sides_m), 0.4) for axis, side in zip("xyz", sides_m, strict=True)
        },
        "camera": {"eye": {"x": 1.0, "y": -1.25, "z": 0.7}, "center": {"x": 0, "y": 0, "z": -0.2}},
    }
    for axis, cells in zip("xyz", size, strict=True):
        ends = [0.5, cells + 0.5]
        space[f"{axis}axis"] = {
            "title": {"text": "depth z" if axis == "z" else axis},
            "range": ends[::-1] if axis == "z" else ends,
            "tickmode": "linear",
            "tick0": 1,
            "dtick": max(1, cells // 5),
            "zeroline": False,
            "showbackground": False,
            "showspikes": False,
        }
    return {"scene": space, "margin": {"l": 0, "r": 0, "t": 0, "b": 0}}
