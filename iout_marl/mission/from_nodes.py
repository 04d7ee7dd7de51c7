"""A scenario of nodes that are somewhere: each is put into the cell that it lies in."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from iout_marl.core.geography import Floats, Place
from iout_marl.errors import InputError, printable
from iout_marl.mission.node_files import NodeFile
from iout_marl.scenario import Scenario, load_scenario
from iout_marl.scenario.layers import Layer, overrides_layer
from iout_marl.scenario.schema import MAX_CELLS
from iout_marl.scenario.sections import Grid, Origin
from iout_marl.scenario.spacing import spacing_text
from iout_marl.words import counted

#: Times that a grid is moved, to lie around nodes: more would bring nothing.
_MOVES = 4


@dataclass(frozen=True)
class SnappedNodes:
    """Nodes in cells.

    Attributes:
        grid: where they lie.
        cells: (nodes, 3), counted from 1.
        moved_m: (nodes,) from where each node is to the centre of its cell.
    """

    grid: Grid
    cells: npt.NDArray[np.int64]
    moved_m: Floats

    @property
    def shared(self) -> dict[tuple[int, ...], list[int]]:
        """The cells of several nodes, with the numbers of these from 1."""
        found: dict[tuple[int, ...], list[int]] = {}
        for number, cell in enumerate(self.cells.tolist(), start=1):
            found.setdefault(tuple(cell), []).append(number)
        return {cell: numbers for cell, numbers in found.items() if len(numbers) > 1}


def snap(nodes: NodeFile, scenario: Scenario, *, keeps_cells: bool) -> SnappedNodes:
    """Put nodes into the cells of a scenario's grid.

    A grid without a place on Earth is laid around nodes that have one: +y to the north, its
    uppermost layer at the depth of the uppermost node.

    Args:
        nodes: where they are.
        scenario: whose grid it is.
        keeps_cells: a grid that is laid around them has the scenario's number of cells, too.

    Raises:
        InputError: a node lies outside the grid, or pyproj is not installed.
    """
    grid = scenario.grid
    if nodes.is_on_earth and grid.origin is None:
        grid = _laid_around(nodes.points, grid, keeps_cells=keeps_cells)
        if math.prod(grid.cells) > MAX_CELLS:
            shape = " × ".join(f"{n:,}" for n in grid.cells)
            raise InputError(
                f"{nodes.name}: the nodes lie so far apart that a grid around them has {shape} "
                f"cells of {spacing_text(grid.spacing_m)}: {MAX_CELLS:,} at most; larger ones by "
                "--set grid.spacing_m"
            )
    place = Place(grid)
    local = place.from_geodetic(nodes.points) if nodes.is_on_earth else nodes.points
    cells = place.cells(local)
    outside = ((cells < 1) | (cells > grid.cells)).any(axis=1)
    if outside.any():
        first = int(np.flatnonzero(outside)[0])
        raise InputError(f"{nodes.places[first]}: {_outside(cells, first, grid)}")
    moved_m = np.linalg.norm(local - place.local(cells), axis=1)
    return SnappedNodes(grid, cells, moved_m)


def _outside(cells: npt.NDArray[np.int64], node: int, grid: Grid) -> str:
    """Why a node is refused, and what would hold all of them."""
    shape = "×".join(map(str, grid.cells))
    text = (
        f"lies outside the grid, in cell {cells[node].tolist()} of {shape} cells of "
        f"{spacing_text(grid.spacing_m)}"
    )
    if (cells >= 1).all():
        needed = np.maximum(cells.max(axis=0), grid.cells).tolist()
        return f"{text}; --set 'grid.cells={needed}' holds all nodes"
    return f"{text}; cell [1, 1, 1] is that of grid.origin, or of x, y, z 0"


def _laid_around(points: Floats, grid: Grid, *, keeps_cells: bool) -> Grid:
    corner = points[0]
    for _ in range(_MOVES):
        place = Place(_with_origin(grid, corner))
        corner = place.geodetic(place.from_geodetic(points).min(axis=0))
    placed = _with_origin(grid, corner)
    if keeps_cells:
        return placed
    place = Place(placed)
    most = place.cells(place.from_geodetic(points)).max(axis=0)
    return placed.model_copy(update={"cells": tuple(most.tolist())})


def _with_origin(grid: Grid, corner: Floats) -> Grid:
    latitude, longitude, depth = (float(value) for value in corner)
    origin = Origin(
        latitude_deg=round(latitude, 9), longitude_deg=round(longitude, 9), depth_m=round(depth, 3)
    )
    return grid.model_copy(update={"origin": origin})


@dataclass(frozen=True)
class Extended:
    """What a scenario of nodes extends, and the settings over it.

    Attributes:
        scenario: as it is.
        settings: what is changed.
        bare: with the settings, but of one node, and with AUVs that start at one cell unless the
            settings say where: what the settings mean for nodes and starts that are replaced
            does not matter.
    """

    scenario: Scenario
    settings: Layer
    bare: Scenario

    @classmethod
    def from_source(cls, source: str, settings: Layer) -> Extended:
        """A scenario by its name or path.

        Raises:
            InputError: as `load_scenario`; or the settings say where nodes lie.
        """
        scenario = load_scenario(source)
        nodes, auvs = settings.data.get("nodes", {}), settings.data.get("auvs", {})
        if not isinstance(nodes, dict):
            raise InputError(f"{settings.origin(('nodes',))}: nodes: must be a mapping of keys")
        for key, allowed in (("cells", ()), ("kind", ("fixed",))):
            if key in nodes and nodes[key] not in allowed:
                where = settings.origin(("nodes", key))
                raise InputError(f"{where}: nodes lie where the file says")
        over: dict[str, Any] = {"nodes": {"kind": "fixed", "cells": [[1, 1, 1]], "weights": None}}
        if isinstance(auvs, dict) and "start_cells" not in auvs:
            over["auvs.start_cells"] = [[1, 1, 1]]
            if "count" not in auvs:
                over["auvs.count"] = scenario.num_auvs
        return cls(scenario, settings, load_scenario(source, overrides_layer(over).over(settings)))

    def moved_start(self, grid: Grid) -> list[int] | None:
        """The middle of a grid, if start cells lie outside it that no setting has named."""
        starts = self.scenario.auvs.start_cells
        if "start_cells" in self.settings.data.get("auvs", {}):
            return None
        if all(_is_inside(cell, grid.cells) for cell in starts):
            return None
        return [(n + 1) // 2 for n in grid.cells]


def scenario_data(
    snapped: SnappedNodes, extended: Extended, extends: str, source: str
) -> dict[str, Any]:
    """What a scenario file says of nodes in cells.

    Args:
        snapped: the nodes.
        extended: what is extended.
        extends: how the file names it.
        source: where the nodes are from.
    """
    grid, settings = snapped.grid, extended.settings.data
    placed = grid.model_dump(mode="json", exclude={"origin"})
    if grid.origin is not None:
        placed["origin"] = grid.origin.model_dump()
    nodes: dict[str, Any] = {"kind": "fixed", "cells": snapped.cells.tolist()}
    if extended.scenario.nodes.part.weights is not None:
        nodes["weights"] = None  # those were of other nodes
    nodes |= settings.get("nodes", {})
    data = {"extends": extends, "description": f"Nodes of {source}", **settings}
    data |= {"grid": placed, "nodes": nodes}
    if (start := extended.moved_start(grid)) is not None:
        count = extended.bare.num_auvs
        data["auvs"] = {**settings.get("auvs", {}), "start_cells": [start], "count": count}
    return data


def _is_inside(cell: Iterable[int], shape: Iterable[int]) -> bool:
    return all(1 <= at <= n for at, n in zip(cell, shape, strict=True))


def described(source: Path, snapped: SnappedNodes, start: list[int] | None) -> str:
    """How many nodes there are, how far they moved, and where AUVs start, if elsewhere."""
    moved = snapped.moved_m
    starts = f"; start cells outside the grid moved to its middle, {start}" if start else ""
    return printable(
        f"{counted(len(moved), 'node')} of {source.name}, each in the cell that it lies in: moved "
        f"by {moved.mean():.1f} m on average, {moved.max():.1f} m at most{starts}"
    )
