"""The grid with all that is in it, drawn from above or from the side."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from iout_marl.render import style
from iout_marl.render.hull import hull_path
from iout_marl.render.labels import auv_name
from iout_marl.render.layout import (
    drawn_edges,
    freest,
    most_stretch,
    place_auvs,
    place_nodes,
    round_step,
    stretched_axes,
)
from iout_marl.render.panel import Panel
from iout_marl.render.scene import Passed, Scene
from iout_marl.render.snapshot import Floats
from iout_marl.scenario.spacing import Edges

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_MOST_CELL_PX = 90  # beyond which the cells of a small grid do not grow
_NUMBER_SIZES = {1: 0.95, 2: 0.88, 3: 0.62, 4: 0.46}  # by digits, relative to the node's radius
_LEAST_PT = 4.0  # below which a number or letter is left out
_MOST_TAGS = 12  # AUVs that can carry a label without hiding everything else
_ASIDE = 0.3  # cells from the first place of a trail to the last, where an AUV has not moved


def _drawn(cells: Any, edge: Any) -> Any:
    """Where the centres of cells are, in the coordinates of a picture."""
    return (cells - 0.5) * edge + 0.5


@dataclass(frozen=True)
class View:
    """A direction of sight.

    Attributes:
        across, along: axes of the grid that run to the right and up (or down) the picture.
        up: 1 if the second one grows upwards, −1 if downwards.
        labelled: whether AUVs carry their tags and batteries, and nodes a mark while they sleep.
    """

    across: int
    along: int
    up: int
    labelled: bool


FROM_ABOVE = View(across=0, along=1, up=1, labelled=True)
FROM_THE_SIDE = View(across=0, along=2, up=-1, labelled=False)


class Projection:
    """A grid as it is seen from one side.

    Args:
        figure: what to draw on.
        view: from where it is seen.
        grid_shape: cells along x, y and z.
        box: place and size, of which a grid of another form takes the upper left part.
        edges_m: edges of a cell along x, y and z. All that is drawn in cells is so in the shortest
            edge that is seen.
    """

    def __init__(
        self,
        figure: Figure,
        view: View,
        grid_shape: tuple[int, int, int],
        box: style.Box,
        edges_m: Edges = (1.0, 1.0, 1.0),
    ) -> None:
        self._view, self._seen = view, [view.across, view.along]
        self._cells = (grid_shape[view.across], grid_shape[view.along])
        self._edges_m = np.array(edges_m)[self._seen]
        left, bottom, width_px, height_px = box
        most = () if view.labelled else (most_stretch(width_px, self._cells[0]),)
        self._edges = drawn_edges(self._edges_m, *most)
        names = "xyz"[view.across] + "xyz"[view.along]
        #: Which axes are drawn longer than they are, and how many times; empty where none is.
        self.stretched = stretched_axes(self._edges_m, names, *most)
        columns, rows = (np.array(self._cells) * self._edges).tolist()
        self._size = size = (columns, rows)
        self._cell_px = cell_px = min(width_px / size[0], height_px / size[1], _MOST_CELL_PX)
        grid_px = (size[0] * cell_px, size[1] * cell_px)
        ends = (0.5, size[1] + 0.5)
        self._panel = Panel(
            figure,
            (left, bottom + height_px - grid_px[1], *grid_px),
            across=(0.5, size[0] + 0.5),
            along=ends if view.up > 0 else ends[::-1],
        )

    def draw_grid(self, title: str = "") -> None:
        """The water, its cells and their numbers."""
        from matplotlib.patches import Rectangle

        panel, (columns, rows) = self._panel, self._size
        lines = []
        for axis, number in enumerate((panel.number_across, panel.number_along)):
            count, edge = self._cells[axis], float(self._edges[axis])
            # Lines and numbers at least as far apart as the eye wants them.
            edge_px = edge * self._cell_px
            number(range(1, count + 1, round_step(20 / edge_px)), partial(_drawn, edge=edge))
            places = np.append(np.arange(0, count, round_step(7 / edge_px)), count) * edge + 0.5
            far = self._size[1 - axis] + 0.5
            ends = [((place, 0.5), (place, far)) for place in places]
            lines += [[end[:: 1 - 2 * axis] for end in line] for line in ends]
        panel.name_across("xyz"[self._view.across])
        panel.name_along("xyz"[self._view.along])
        panel.title(", ".join(filter(None, [title, self.stretched])))
        water = Rectangle((0.5, 0.5), columns, rows)
        panel.draw_patches([water], facecolor=style.WATER, linewidth=0, zorder=0.5)
        panel.draw_segments(lines, colors=style.HAIRLINE, linewidths=0.8, zorder=1)

    def draw(self, scene: Scene, node_colours: Floats) -> None:
        """Draw all that is in the grid.

        Args:
            scene: what to draw.
            node_colours: (nodes, 4) colours with transparency, 0 to 1.
        """
        node_cells, auv_cells = scene.nodes[:, self._seen], scene.auvs[:, self._seen]
        node_at, node_radius = place_nodes(node_cells, smallest=6 / self._cell_px)
        auv_at, auv_size = place_auvs(auv_cells, node_cells, self._view.up, self._cells[1])
        node_at += _drawn(node_cells, self._edges) - node_cells
        auv_at += _drawn(auv_cells, self._edges) - auv_cells
        # In a wide grid AUVs are larger than a cell.
        auv_size = auv_size * max(0.92, 22 / self._cell_px)
        self._draw_docks(scene)
        if len(scene.path) > 1:
            self._draw_trails(scene, node_at)
        self._draw_courses(scene, auv_at)
        self._draw_charging(scene, node_at, auv_at)
        self._draw_packets(scene, node_at, auv_at)
        self._draw_nodes(scene, node_at, node_radius, node_colours)
        self._draw_auvs(scene, auv_at, auv_size)
        if self._view.labelled and scene.tags and scene.num_auvs <= _MOST_TAGS:
            self._draw_tags(scene, node_at, auv_at)

    def _draw_trails(self, scene: Scene, node_at: Floats) -> None:
        """Where the AUVs came from, whom they charged and heard on their way.

        Of a whole episode each place lies a little beside the one before: a cell that an AUV comes
        through once more, and a way that it takes once more, are seen. What passes between a cell
        and a node time and again is drawn once, amid the visits, and charging, which is rarer,
        above packets.
        """
        places = _drawn(scene.path[..., self._seen], self._edges)  # (places, auvs, 2)
        if scene.from_start:
            places += np.linspace(-_ASIDE, 0, len(places))[:, None, None] * (1, self._view.up)
        steps = np.stack([places[:-1], places[1:]], axis=2)  # (slots, auvs, ends, 2)
        colours = style.trail_colours(len(steps), scene.num_auvs)
        self._panel.draw_segments(
            list(steps.reshape(-1, 2, 2)), colors=colours.reshape(-1, 4), linewidths=1.6, zorder=1.9
        )
        for what in Passed:
            visits: dict[tuple[float, ...], list[Floats]] = {}
            for link in scene.earlier:
                if link.what is what:
                    cell = scene.path[link.place, link.auv, self._seen]
                    visits.setdefault((link.auv, link.node, *cell), []).append(
                        places[link.place, link.auv]
                    )
            at = np.array([np.mean(where, axis=0) for where in visits.values()]).reshape(-1, 2)
            nodes = [int(node) for _, node, *_ in visits]
            beams = [(place, node_at[node]) for place, node in zip(at, nodes, strict=True)]
            colour, dashes = style.LINKS[what], style.DASHES[what]
            thin = {"linewidths": 0.6, "alpha": 0.3, "zorder": 1.8}
            if what is Passed.CHARGE:
                thin = {"linewidths": 0.8, "alpha": 0.5, "zorder": 1.85}
            self._panel.draw_segments(beams, colors=colour, linestyles=[dashes], **thin)
            if what in style.MARKS:
                mark = {"marker": style.MARKS[what], "ms": 3.4, "mew": 0, "ls": "none"}
                self._panel.draw_line(*at.T, color=colour, zorder=2, **mark)
        if not scene.from_start:
            return
        start = {"marker": "o", "ms": 9, "mfc": "none", "mew": 1.3, "ls": "none"}
        self._panel.draw_line(*places[0].T, color=style.INK, zorder=2.1, **start)

    def _draw_docks(self, scene: Scene) -> None:
        """Frames around the cells in which AUVs are recharged."""
        from matplotlib.patches import Rectangle

        if scene.docks is None:
            return
        corners = _drawn(scene.docks[:, self._seen], self._edges) - 0.5 * self._edges
        frames = [Rectangle(tuple(corner), *self._edges) for corner in corners.tolist()]
        look = {"facecolor": style.DOCK, "edgecolor": style.INK, "linewidth": 1.2}
        self._panel.draw_patches(frames, zorder=1.5, **look)

    def _draw_courses(self, scene: Scene, auv_at: Floats) -> None:
        """A dotted line from each AUV under way to the cell that it heads for."""
        for auv, cell in scene.headings.items():
            end = _drawn(cell[self._seen], self._edges)
            colour = self._auv_colour(scene, auv)
            line = {"color": colour, "linewidth": 1.5, "linestyle": style.COURSE, "zorder": 2.2}
            self._panel.draw_line(*np.stack([auv_at[auv], end]).T, **line)
            ring = {"marker": "o", "ms": 7, "mfc": "none", "mec": colour, "mew": 1.3}
            self._panel.draw_line(*end, ls="none", zorder=2.2, **ring)

    def _draw_charging(self, scene: Scene, node_at: Floats, auv_at: Floats) -> None:
        charging = [link for link in scene.links if link.what is Passed.CHARGE]
        beams = [(auv_at[link.auv], node_at[link.node]) for link in charging]
        width_pt = min(max(0.15 * self._cell_px, 3.0), 6.5)
        look = {"colors": style.LINKS[Passed.CHARGE], "alpha": 0.45, "linewidths": width_pt}
        self._panel.draw_segments(beams, zorder=2, **look)

    def _draw_packets(self, scene: Scene, node_at: Floats, auv_at: Floats) -> None:
        """A line from the node heard: an arrow if its packet arrived, else dashes and a cross."""
        for link in scene.links:
            if link.what is Passed.CHARGE:
                continue
            ends = np.stack([node_at[link.node], auv_at[link.auv]])
            look = {"color": style.LINKS[link.what]}
            dashes = style.DASHES[link.what]
            self._panel.draw_line(*ends.T, linewidth=1.6, linestyle=dashes, zorder=2.5, **look)
            way = (ends[1] - ends[0]) * (1, self._view.up)
            if np.linalg.norm(way) * self._cell_px < 40:
                continue  # no room for a symbol between the two
            heading_deg = float(np.degrees(np.arctan2(way[1], way[0])))
            arrow = (3, 0, heading_deg - 90)
            self._panel.draw_line(
                *ends.mean(axis=0),
                marker=arrow if link.what is Passed.PACKET else style.MARKS[link.what],
                markersize=8.5,
                markeredgecolor="white",
                markeredgewidth=0.8,
                zorder=2.6,
                **look,
            )

    def _draw_nodes(
        self, scene: Scene, node_at: Floats, node_radius: Floats, node_colours: Floats
    ) -> None:
        """Discs, where there is a charge in rings that it fills clockwise."""
        from matplotlib.patches import Circle, Wedge

        tracks, rings, discs = [], [], []
        ringed = scene.charge is not None
        shares = scene.charge if scene.charge is not None else np.zeros(len(node_at))
        for (x, y), radius, share in zip(node_at, node_radius, shares, strict=True):
            # From the top, clockwise to the eye even where the axis runs downwards.
            sweep = 360 * float(share)
            start, end = (90 - sweep, 90) if self._view.up > 0 else (270, 270 + sweep)
            if ringed:
                tracks.append(Circle((x, y), radius))
            if share > 0:
                rings.append(Wedge((x, y), radius, start, end, width=0.26 * radius))
            discs.append(Circle((x, y), 0.74 * radius))
        for patches, face, edge, zorder in (
            (tracks, "white", style.MUTED, 3),
            (rings, style.ENERGY, "none", 3.1),
            (discs, node_colours, style.INK, 3.2),
        ):
            look = {"facecolor": face, "edgecolor": edge, "linewidth": 0.5}
            self._panel.draw_patches(patches, zorder=zorder, **look)
        for node in scene.asleep if self._view.labelled else ():
            (x, y), off = node_at[node], 0.95 * node_radius[node]
            self._panel.write(
                x - off,
                y + self._view.up * off,
                style.ASLEEP,
                fontsize=9,
                color=style.INK,
                va="center_baseline",
                zorder=3.4,
                bbox={"boxstyle": "circle,pad=0.06", "fc": "white", "ec": "none", "alpha": 0.8},
            )
        luminance = node_colours[:, :3] @ (0.299, 0.587, 0.114)
        for node, (x, y) in enumerate(node_at):
            share_of_radius = _NUMBER_SIZES[min(len(str(node + 1)), 4)]
            size_pt = share_of_radius * node_radius[node] * self._cell_px * style.PT_PER_PX
            colour = style.INK if luminance[node] > 0.5 else "white"
            self._write_within(x, y, str(node + 1), size_pt, color=colour, zorder=3.3)

    def _draw_auvs(self, scene: Scene, auv_at: Floats, auv_size: Floats) -> None:
        from matplotlib.patches import PathPatch
        from matplotlib.transforms import Affine2D

        shape = hull_path()
        hulls = [
            PathPatch(shape.transformed(Affine2D().scale(length).translate(x, y)))
            for (x, y), length in zip(auv_at, auv_size, strict=True)
        ]
        colours = [
            style.FAILED if auv in scene.stranded else self._auv_colour(scene, auv)
            for auv in range(scene.num_auvs)
        ]
        look = {"edgecolor": "white", "linewidth": 1, "joinstyle": "round"}
        self._panel.draw_patches(hulls, facecolor=colours, zorder=4, **look)
        for auv, ((x, y), length) in enumerate(zip(auv_at, auv_size, strict=True)):
            if scene.num_auvs > 1:
                size_pt = 0.27 * length * self._cell_px * style.PT_PER_PX
                self._write_within(x, y, auv_name(auv), size_pt, color="white", zorder=4.1)
        if scene.battery is not None and self._view.labelled:
            self._draw_batteries(scene.battery, auv_at, auv_size)

    def _draw_batteries(self, battery: Floats, auv_at: Floats, auv_size: Floats) -> None:
        """A bar above each AUV, as full as its battery."""
        from matplotlib.patches import Rectangle

        height = 4 / self._cell_px
        frames, bars = [], []
        for (x, y), length, share in zip(auv_at, auv_size, battery.tolist(), strict=True):
            width = 0.9 * length
            above = y + self._view.up * (0.22 * length + 0.5 * height)
            corner = (x - width / 2, above - height / 2)
            frames.append(Rectangle(corner, width, height))
            bars.append(Rectangle(corner, share * width, height))
        frame = {"facecolor": "white", "edgecolor": style.INK, "linewidth": 0.7}
        self._panel.draw_patches(frames, zorder=4.15, **frame)
        colours = [style.ENERGY if share > style.LOW_BATTERY else style.FAILED for share in battery]
        self._panel.draw_patches(bars, facecolor=colours, linewidth=0, zorder=4.16)

    def _auv_colour(self, scene: Scene, auv: int) -> str:
        is_one_of_several = len(scene.path) > 1 and scene.num_auvs > 1
        return style.auv_colour(auv) if is_one_of_several else style.AUV

    def _write_within(self, x: float, y: float, text: str, size_pt: float, **options: Any) -> None:
        """Write on a node or an AUV, if it is large enough."""
        if size_pt >= _LEAST_PT:
            bold: dict[str, Any] = {"fontweight": "bold", "va": "center_baseline"}
            self._panel.write(x, y, text, fontsize=min(size_pt, 10), **bold, **options)

    def _draw_tags(self, scene: Scene, node_at: Floats, auv_at: Floats) -> None:
        """Beside each AUV its tag, for AUVs of one column in one."""
        lines = [(auv_at[link.auv], node_at[link.node]) for link in scene.links]
        columns: dict[tuple[float, float], list[int]] = {}
        for auv, (x, y, _) in enumerate(scene.auvs.tolist()):
            columns.setdefault((x, y), []).append(auv)
        for auvs in columns.values():
            # From top to bottom, as they stand.
            texts = [
                f"{auv_name(auv)}  {scene.tags[auv]}" if len(auvs) > 1 else scene.tags[auv]
                for auv in reversed(auvs)
            ]
            half_width = 3.0 * max(map(len, texts)) / self._cell_px
            half_height = 5.5 * len(texts) / self._cell_px
            x, y = auv_at[auvs].mean(axis=0)
            stack = auv_at[auvs[-1], 1] - y  # from the middle of the stack to its top
            down = 13.5 / self._cell_px + stack + half_height
            right = 24 / self._cell_px + half_width
            beside, above = [(x + right, y), (x - right, y)], [(x, y - down), (x, y + down)]
            places = above + beside if len(auvs) == 1 else beside + above
            others = np.concatenate([node_at, np.delete(auv_at, auvs, axis=0)])
            best = places[freest(places, (half_width, half_height), others, lines, self._size)]
            self._panel.write(
                *best,
                "\n".join(texts),
                fontsize=style.SMALL_PT,
                fontweight="bold",
                color=style.AUV,
                va="center_baseline" if len(texts) == 1 else "center",
                linespacing=1.1,
                zorder=4.2,
                bbox={"boxstyle": "round,pad=0.18", "fc": "white", "ec": "none", "alpha": 0.8},
            )
