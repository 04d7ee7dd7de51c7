"""Figures, described once: `plotly_writer` draws them in a page, `matplotlib_writer` as files."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

from iout_marl.render.scene import Scene
from iout_marl.scenario.spacing import edges_m
from iout_marl.trajectory import Trajectory
from iout_marl.words import place_text


@dataclass(frozen=True)
class Axis:
    """An axis of a `Plot`.

    Attributes:
        label: what it shows, with its unit.
        scale: `categories` are equally spaced, in ascending order.
        limits: where it ends; None for the ends of the data.
        ticks_at_values: ticks at the few values alone at which something was measured. Only
            such an axis may have values of 0 or below on a logarithmic scale.
        names: of the values 1, 2, 3 …, in place of the numbers.
    """

    label: str
    scale: Literal["linear", "log", "categories"] = "linear"
    limits: tuple[float, float] | None = None
    ticks_at_values: bool = False
    names: tuple[str, ...] = ()

    def text(self, value: float) -> str:
        """A value in words."""
        return self.names[round(value) - 1] if self.names else place_text(value)

    @property
    def is_log(self) -> bool:
        """Whether its scale is logarithmic."""
        return self.scale == "log"

    @property
    def is_categorical(self) -> bool:
        """Whether its values are categories (K = 3, 5, 7, 10), each with a tick."""
        return self.scale == "categories"

    @property
    def has_single_values(self) -> bool:
        """Whether its values are few, and no points of a curve."""
        return self.is_categorical or self.ticks_at_values


@dataclass(frozen=True)
class Line:
    """One curve, or one bar of every group, of a `Plot`.

    Attributes:
        name: what the legend calls it.
        x, y: the points.
        low, high: 95 % confidence interval at every point; empty where there is none. A
            single point without one has NaN.
        dashed: drawn so.
        joined: False for points alone.
        colour: which look of the palette, where lines of several names belong together; None for
            that of its series throughout the report, or of its place among the lines.
        in_legend: False for a line that shares the legend's entry of another.
    """

    name: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()
    dashed: bool = False
    joined: bool = True
    colour: int | None = None
    in_legend: bool = True


@dataclass(frozen=True)
class Plot:
    """Lines over a common axis; of categories, a group of bars over each.

    Attributes:
        key: name of its files, and its anchor in the page.
        caption: what it shows: seeds, episodes, what is scored, what the interval is of.
        command: what makes it.
    """

    key: str
    title: str
    caption: str
    command: str
    x: Axis
    y: Axis
    lines: tuple[Line, ...]

    def rows(self) -> Iterator[tuple[object, ...]]:
        """The data as a table, its headings first."""
        yield ("series", self.x.label, self.y.label, "ci95_low", "ci95_high")
        for line in self.lines:
            for i, (x, y) in enumerate(zip(line.x, line.y, strict=True)):
                interval = (line.low[i], line.high[i]) if line.low else ("", "")
                yield (line.name, self.x.text(x) if self.x.names else x, y, *interval)


@dataclass(frozen=True)
class TrajectoryPlot:
    """The paths of the AUVs through the grid in one episode, and whom they charged and heard."""

    key: str
    title: str
    caption: str
    command: str
    episode: Trajectory

    def scene(self) -> Scene:
        """The episode as it is drawn."""
        e = self.episode
        rows = (e.nodes, e.path, e.charged, e.heard, e.delivered, list(e.polls()))
        return Scene.from_episode(e.grid, *rows, edges_m(e.spacing_m), e.docks)

    def rows(self) -> Iterator[tuple[object, ...]]:
        """The data as a table, its headings first; AUVs and nodes are counted from 1."""
        episode = self.episode
        ages = [f"age_node_{i + 1}" for i in range(len(episode.nodes))]
        outcomes: tuple[bool, ...] = (True, False) if episode.polled is not None else ()
        names = ("polled_lost", "polled_delivered")
        what = ("charged", "heard", "delivered", *(names[arrived] for arrived in outcomes))
        polled: dict[tuple[int, int, bool], list[str]] = defaultdict(list)
        for at, who, node, arrived in episode.polls():
            polled[at, who + 1, arrived].append(str(node))
        yield ("slot", "auv", "x_cell", "y_cell", "z_cell", *what, *ages)
        slots = (episode.path[1:], episode.charged, episode.heard, episode.delivered, episode.ages)
        for slot, (*of_auvs, of_nodes) in enumerate(zip(*slots, strict=True), start=1):
            for auv, (cell, charged, heard, delivered) in enumerate(zip(*of_auvs, strict=True), 1):
                beside = (" ".join(polled[slot, auv, arrived]) for arrived in outcomes)
                yield (slot, auv, *cell, charged, heard, int(delivered), *beside, *of_nodes)


Figure: TypeAlias = Plot | TrajectoryPlot
