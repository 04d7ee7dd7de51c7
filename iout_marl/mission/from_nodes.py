"""A scenario of nodes that are somewhere: each is put into the cell that it lies in."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from iout_marl.errors import InputError, printable
from iout_marl.mission.geography import Floats, Place
from iout_marl.mission.node_files import NodeFile
from iout_marl.scenario import Scenario
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


def scenario_data(
    snapped: SnappedNodes, scenario: Scenario, settings: dict[str, Any], extends: str, source: str
) -> dict[str, Any]:
    """What a scenario file says of nodes in cells.

    Args:
        snapped: the nodes.
        scenario: what is extended, with the settings.
        settings: what else the file changes.
        extends: how it names what it extends.
        source: where the nodes are from.
    """
    grid = snapped.grid
    placed = grid.model_dump(mode="json", exclude={"origin"})
    if grid.origin is not None:
        placed["origin"] = grid.origin.model_dump()
    nodes: dict[str, Any] = {"kind": "fixed", "cells": snapped.cells.tolist()}
    if scenario.nodes.part.weights is not None:
        nodes["weights"] = None  # those were of other nodes
    data = {"extends": extends, "description": f"Nodes of {source}", **settings}
    data |= {"grid": placed, "nodes": nodes}
    starts = scenario.auvs.start_cells
    if not all(_is_inside(cell, grid.cells) for cell in starts):
        middle = [(n + 1) // 2 for n in grid.cells]
        own = {**settings.get("auvs", {}), "start_cells": [middle], "count": scenario.num_auvs}
        data["auvs"] = own
    return data


def _is_inside(cell: Iterable[int], shape: Iterable[int]) -> bool:
    return all(1 <= at <= n for at, n in zip(cell, shape, strict=True))


def described(source: Path, snapped: SnappedNodes) -> str:
    """How many nodes there are, and how far they moved."""
    moved = snapped.moved_m
    return printable(
        f"{counted(len(moved), 'node')} of {source.name}, each in the cell that it lies in: moved "
        f"by {moved.mean():.1f} m on average, {moved.max():.1f} m at most"
    )
