"""The water with AUVs, nodes and what passed between them, from above or from the side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from iout_marl.render import style
from iout_marl.render.labels import auv_name
from iout_marl.render.layout import freest, place_auvs, place_nodes, round_step
from iout_marl.render.panel import Panel
from iout_marl.render.snapshot import Floats, Snapshot

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.path import Path


_MOST_CELL_PX = 90  # beyond which the cells of a small grid do not grow
_NUMBER_SIZES = {1: 0.95, 2: 0.88, 3: 0.62}  # by digits, relative to the node's radius
_LEAST_PT = 4.0  # below which a number or letter is left out
_MOST_TAGS = 12  # AUVs that can carry a label without hiding everything else


@dataclass(frozen=True)
class View:
    """A direction of sight.

    Attributes:
        across, along: axes of the grid that run to the right and up (or down) the picture.
        up: 1 if the second one grows upwards, −1 if downwards.
        labelled: whether AUVs carry their depth, and lines their symbols.
    """

    across: int
    along: int
    up: int
    labelled: bool


FROM_ABOVE = View(across=0, along=1, up=1, labelled=True)
FROM_THE_SIDE = View(across=0, along=2, up=-1, labelled=False)


def draw_scene(
    figure: Figure,
    snapshot: Snapshot,
    view: View,
    box: style.Box,
    node_colours: Floats,
    title: str = "",
) -> None:
    """Draw the grid with all that is in it.

    Args:
        figure: what to draw on.
        snapshot: what to draw.
        view: from where it is seen.
        box: place and size, of which a grid of another form takes the upper left part.
        node_colours: (nodes, 4) colours with transparency, 0 to 1.
        title: what to write above.
    """
    seen = [view.across, view.along]
    size = (snapshot.grid_shape[view.across], snapshot.grid_shape[view.along])
    cell_px = min(box[2] / size[0], box[3] / size[1], _MOST_CELL_PX)
    axes = _draw_grid(figure, size, view, box, cell_px, title)
    node_cells, auv_cells = snapshot.node_positions[:, seen], snapshot.auv_positions[:, seen]
    node_at, node_radius = place_nodes(node_cells, smallest=6 / cell_px)
    auv_at, auv_size = place_auvs(auv_cells, node_cells, view.up)
    # In a wide grid AUVs are larger than a cell.
    auv_size = auv_size * max(0.92, 22 / cell_px)

    _draw_charging(axes, snapshot, node_at, auv_at, cell_px)
    _draw_uplinks(axes, snapshot, view, node_at, auv_at, cell_px)
    _draw_nodes(axes, snapshot, view, node_at, node_radius, node_colours, cell_px)
    _draw_auvs(axes, snapshot, auv_at, auv_size, cell_px)
    if view.labelled and snapshot.num_auvs <= _MOST_TAGS:
        _draw_tags(axes, snapshot, node_at, auv_at, size, cell_px)


def _draw_grid(
    figure: Figure,
    size: tuple[int, int],
    view: View,
    box: style.Box,
    cell_px: float,
    title: str,
) -> Axes:
    from matplotlib.collections import LineCollection
    from matplotlib.patches import Rectangle

    left, bottom, _, height_px = box
    grid_px = (size[0] * cell_px, size[1] * cell_px)
    ends = (0.5, size[1] + 0.5)
    panel = Panel(
        figure,
        (left, bottom + height_px - grid_px[1], *grid_px),
        across=(0.5, size[0] + 0.5),
        along=ends if view.up > 0 else ends[::-1],
    )
    # Lines and numbers at least as far apart as the eye wants them.
    numbers_every = round_step(20 / cell_px)
    panel.number_across(range(1, size[0] + 1, numbers_every))
    panel.number_along(range(1, size[1] + 1, numbers_every))
    panel.name_across("xyz"[view.across])
    panel.name_along("xyz"[view.along])
    panel.title(title)

    lines_every = round_step(7 / cell_px)
    x_lines = np.append(np.arange(0, size[0], lines_every), size[0]) + 0.5
    y_lines = np.append(np.arange(0, size[1], lines_every), size[1]) + 0.5
    lines = [[(x, 0.5), (x, size[1] + 0.5)] for x in x_lines]
    lines += [[(0.5, y), (size[0] + 0.5, y)] for y in y_lines]
    axes = panel.axes
    axes.add_patch(Rectangle((0.5, 0.5), *size, facecolor=style.WATER, linewidth=0, zorder=0.5))
    axes.add_collection(
        LineCollection(lines, colors=style.HAIRLINE, linewidths=0.8, zorder=1, clip_on=False)
    )
    return axes


def _draw_charging(
    axes: Axes, snapshot: Snapshot, node_at: Floats, auv_at: Floats, cell_px: float
) -> None:
    from matplotlib.collections import LineCollection

    beams = [(auv_at[auv], node_at[node]) for auv, node in snapshot.charging()]
    width_pt = min(max(0.15 * cell_px, 3.0), 6.5)
    axes.add_collection(
        LineCollection(beams, colors=style.ENERGY, alpha=0.45, linewidths=width_pt, zorder=2)
    )


def _draw_uplinks(
    axes: Axes,
    snapshot: Snapshot,
    view: View,
    node_at: Floats,
    auv_at: Floats,
    cell_px: float,
) -> None:
    """A line from the node heard: an arrow if its packet arrived, else dashes and a cross."""
    for auv, node, arrived in snapshot.hearing():
        ends = np.stack([node_at[node], auv_at[auv]])
        colour = style.DATA if arrived else style.FAILED
        dashes = "solid" if arrived else (0, (4, 2.5))
        axes.plot(*ends.T, color=colour, linewidth=1.6, linestyle=dashes, zorder=2.5)
        way = (ends[1] - ends[0]) * (1, view.up)
        if np.linalg.norm(way) * cell_px < 40:
            continue  # no room for a symbol between the two
        heading_deg = float(np.degrees(np.arctan2(way[1], way[0])))
        axes.plot(
            *ends.mean(axis=0),
            color=colour,
            marker=(3, 0, heading_deg - 90) if arrived else "X",
            markersize=8.5,
            markeredgecolor="white",
            markeredgewidth=0.8,
            zorder=2.6,
        )


def _draw_nodes(
    axes: Axes,
    snapshot: Snapshot,
    view: View,
    node_at: Floats,
    node_radius: Floats,
    node_colours: Floats,
    cell_px: float,
) -> None:
    """Discs in the colour of the age, in rings that the energy fills clockwise."""
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Circle, Wedge

    charge = np.minimum(snapshot.energies_j / snapshot.energy_yardstick_j, 1.0)
    tracks, rings, discs = [], [], []
    for (x, y), radius, share in zip(node_at, node_radius, charge, strict=True):
        # From the top, clockwise to the eye even where the axis runs downwards.
        sweep = 360 * float(share)
        start, end = (90 - sweep, 90) if view.up > 0 else (270, 270 + sweep)
        tracks.append(Circle((x, y), radius))
        if share > 0:
            rings.append(Wedge((x, y), radius, start, end, width=0.26 * radius))
        discs.append(Circle((x, y), 0.74 * radius))
    thin: dict[str, Any] = {"linewidth": 0.5, "clip_on": False}
    axes.add_collection(
        PatchCollection(tracks, facecolor="white", edgecolor=style.MUTED, zorder=3, **thin)
    )
    axes.add_collection(
        PatchCollection(rings, facecolor=style.ENERGY, edgecolor="none", zorder=3.1, **thin)
    )
    axes.add_collection(
        PatchCollection(discs, facecolor=node_colours, edgecolor=style.INK, zorder=3.2, **thin)
    )
    luminance = node_colours[:, :3] @ (0.299, 0.587, 0.114)
    for node, (x, y) in enumerate(node_at):
        share_of_radius = _NUMBER_SIZES[min(len(str(node + 1)), 3)]
        size_pt = share_of_radius * node_radius[node] * cell_px * style.PT_PER_PX
        if size_pt < _LEAST_PT:
            continue
        axes.text(
            x,
            y,
            str(node + 1),
            fontsize=min(size_pt, 10),
            fontweight="bold",
            color=style.INK if luminance[node] > 0.5 else "white",
            ha="center",
            va="center_baseline",
            zorder=3.3,
        )


def _draw_auvs(
    axes: Axes, snapshot: Snapshot, auv_at: Floats, auv_size: Floats, cell_px: float
) -> None:
    from matplotlib.patches import PathPatch
    from matplotlib.transforms import Affine2D

    shape = hull()
    for auv, ((x, y), length) in enumerate(zip(auv_at, auv_size, strict=True)):
        axes.add_patch(
            PathPatch(
                shape.transformed(Affine2D().scale(length).translate(x, y)),
                facecolor=style.AUV,
                edgecolor="white",
                linewidth=1,
                zorder=4,
                clip_on=False,
                joinstyle="round",
            )
        )
        size_pt = 0.27 * length * cell_px * style.PT_PER_PX
        if snapshot.num_auvs > 1 and size_pt >= _LEAST_PT:
            axes.text(
                x,
                y,
                auv_name(auv),
                fontsize=min(size_pt, 10),
                fontweight="bold",
                color="white",
                ha="center",
                va="center_baseline",
                zorder=4.1,
            )


def hull() -> Path:
    """An AUV of length 1 around the origin, its nose to the right."""
    from matplotlib.path import Path

    upper: list[tuple[np.uint8, tuple[float, float]]] = [
        (Path.MOVETO, (-0.5, 0.0)),
        (Path.LINETO, (-0.5, 0.21)),  # tail fin
        (Path.LINETO, (-0.43, 0.21)),
        (Path.LINETO, (-0.36, 0.1)),
        (Path.CURVE4, (-0.3, 0.16)),  # body
        (Path.CURVE4, (-0.22, 0.185)),
        (Path.CURVE4, (-0.12, 0.185)),
        (Path.LINETO, (0.22, 0.185)),
        (Path.CURVE4, (0.4, 0.185)),  # nose
        (Path.CURVE4, (0.5, 0.1)),
        (Path.CURVE4, (0.5, 0.0)),
    ]
    # The lower half is the upper one, backwards; a segment's code stands at its end.
    codes = [code for code, _ in upper]
    points = [point for _, point in upper]
    codes += [*codes[:0:-1], Path.CLOSEPOLY]
    points += [(x, -y) for x, y in reversed(points[:-1])]
    points.append(points[0])
    return Path(points, codes)


def _draw_tags(
    axes: Axes,
    snapshot: Snapshot,
    node_at: Floats,
    auv_at: Floats,
    size: tuple[int, int],
    cell_px: float,
) -> None:
    """Beside each AUV its depth and in TDD its β, for AUVs of one column in one tag."""
    lines = [(auv_at[auv], node_at[node]) for auv, node in snapshot.charging()]
    lines += [(auv_at[auv], node_at[node]) for auv, node, _ in snapshot.hearing()]
    columns: dict[tuple[int, int], list[int]] = {}
    for auv, (x, y, _) in enumerate(snapshot.auv_positions.tolist()):
        columns.setdefault((x, y), []).append(auv)
    for auvs in columns.values():
        # From top to bottom, as they stand.
        texts = [_tag(snapshot, auv, named=len(auvs) > 1) for auv in reversed(auvs)]
        half_width = 3.0 * max(map(len, texts)) / cell_px
        half_height = 5.5 * len(texts) / cell_px
        x, y = auv_at[auvs].mean(axis=0)
        stack = auv_at[auvs[-1], 1] - y  # from the middle of the stack to its top
        down, right = 13.5 / cell_px + stack + half_height, 24 / cell_px + half_width
        beside, above = [(x + right, y), (x - right, y)], [(x, y - down), (x, y + down)]
        places = above + beside if len(auvs) == 1 else beside + above
        others = np.concatenate([node_at, np.delete(auv_at, auvs, axis=0)])
        best = places[freest(places, (half_width, half_height), others, lines, size)]
        axes.text(
            *best,
            "\n".join(texts),
            fontsize=style.SMALL_PT,
            fontweight="bold",
            color=style.AUV,
            ha="center",
            va="center_baseline" if len(texts) == 1 else "center",
            linespacing=1.1,
            zorder=4.2,
            bbox={"boxstyle": "round,pad=0.18", "fc": "white", "ec": "none", "alpha": 0.8},
        )


def _tag(snapshot: Snapshot, auv: int, *, named: bool) -> str:
    words = [auv_name(auv)] if named else []
    words.append(f"z {snapshot.auv_positions[auv, 2]}")
    if snapshot.splits_slot and snapshot.beta is not None:
        words.append(f"β {snapshot.beta[auv]:.2f}")
    return "  ".join(words)
