"""Where nodes are, as a user's CSV or GeoJSON file says."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from iout_marl.core.geography import Floats
from iout_marl.errors import InputError, did_you_mean
from iout_marl.files import parse_json, read_if_there
from iout_marl.scenario.fields import MAX_NODES
from iout_marl.scenario.places import show_file
from iout_marl.whole import is_number, short
from iout_marl.words import listed

#: What columns may be called, after `_plain`.
_NAMES = {
    "latitude": ("latitude", "lat"),
    "longitude": ("longitude", "lon", "long", "lng"),
    "x": ("x",),
    "y": ("y",),
    "depth": ("depth", "z"),
}
_ON_EARTH, _IN_METRES = ("latitude", "longitude", "depth"), ("x", "y", "depth")
_NEEDED = "latitude, longitude and depth, or x, y and z, are needed"
_LIMITS = {"latitude": 90.0, "longitude": 180.0, "x": 1e9, "y": 1e9, "depth": 1e9}


@dataclass(frozen=True)
class NodeFile:
    """The nodes of a file.

    Attributes:
        is_on_earth: they are latitudes, longitudes and depths; otherwise x, y and depth in m.
        points: (nodes, 3).
        places: where each node stands in the file, for messages.
        name: of the file.
    """

    is_on_earth: bool
    points: Floats
    places: tuple[str, ...]
    name: str = ""


def read_nodes(path: Path) -> NodeFile:
    """Read a file of nodes: GeoJSON if its name says so, else CSV.

    Raises:
        InputError: it cannot be read, or says something else; with line and column.
    """
    data = read_if_there(path)
    if data is None:
        raise InputError(f"{path}: no such file")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{show_file(path)}: must be UTF-8 text ({error.reason})") from None
    is_geojson = path.suffix.lower() in (".geojson", ".json")
    found = (_from_geojson if is_geojson else _from_csv)(text, show_file(path))
    if not 1 <= len(found.points) <= MAX_NODES:
        number = len(found.points) or "no"
        raise InputError(f"{show_file(path)}: has {number} nodes; 1 to {MAX_NODES:,} are allowed")
    return replace(found, name=show_file(path))


def _plain(name: str) -> str:
    """A heading without what makes no difference: case, units, blanks."""
    bare = re.sub(r"[(\[].*?[)\]]", "", name.lower()).strip().replace(" ", "_")
    return re.sub(r"_(deg|degrees|m|metres|meters)$", "", bare)


def _columns(headings: Sequence[str], where: str) -> dict[str, int]:
    """The columns that say where a node is, by what they are.

    Raises:
        InputError: one is missing, or there twice.
    """
    plain = [_plain(heading) for heading in headings]
    found: dict[str, int] = {}
    for meaning, names in _NAMES.items():
        places = [i for i, name in enumerate(plain) if name in names]
        if len(places) > 1:
            twice = listed([repr(headings[i]) for i in places])
            raise InputError(f"{where}: has two columns for the {meaning}: {twice}")
        if places:
            found[meaning] = places[0]
    kinds = [k for k in (_ON_EARTH, _IN_METRES) if any(name in found for name in k[:2])]
    if len(kinds) > 1:
        raise InputError(f"{where}: has columns of both kinds; only {_NEEDED}")
    missing = [name for name in kinds[0] if name not in found] if kinds else ["latitude"]
    if missing:
        others = [heading for i, heading in enumerate(headings) if i not in found.values()]
        near = [
            did_you_mean(_plain(heading), _NAMES[missing[0]], or_list=False) for heading in others
        ]
        hint = next(filter(None, near), f"; there are {', '.join(map(short, headings[:9]))}")
        raise InputError(f"{where}: has no column for the {missing[0]}: {_NEEDED}{hint}")
    return {name: found[name] for name in kinds[0]}


def _from_csv(text: str, file: str) -> NodeFile:
    rows = list(_rows(text, file))
    if not rows:
        raise InputError(f"{file}: is empty; a line of headings is needed")
    first_line, headings = rows[0]
    columns = _columns(headings, f"{file}:{first_line}")
    points, places = [], []
    for line, row in rows[1:]:
        where = f"{file}:{line}"
        if len(row) != len(headings):
            missing = f": no {headings[len(row)]!r}" if len(row) < len(headings) else ""
            raise InputError(f"{where}: has {len(row)} of {len(headings)} columns{missing}")
        points.append(
            [
                _number(row[i], name, f"{where}: column {headings[i]!r}")
                for name, i in columns.items()
            ]
        )
        places.append(where)
    return _node_file(tuple(columns) == _ON_EARTH, points, places)


def _rows(text: str, file: str) -> Iterator[tuple[int, list[str]]]:
    """Lines by number, from 1, and their cells; without those that are empty or begin with #."""
    lines = io.StringIO(text, newline="")
    written = (line.lstrip() for line in text.splitlines())
    head = next((line for line in written if line and line[0] != "#"), "")
    delimiter = max(",;\t", key=head.count)
    reader = csv.reader(lines, delimiter=delimiter, strict=True)
    try:
        for row in reader:
            cells = [cell.strip() for cell in row]
            if any(cells) and not cells[0].startswith("#"):
                yield reader.line_num, cells
    except csv.Error as error:
        raise InputError(f"{file}:{reader.line_num}: is no CSV: {error}") from None


def _from_geojson(text: str, file: str) -> NodeFile:
    try:
        whole = parse_json(text)
    except ValueError as error:
        raise InputError(f"{file}: is no JSON: {error}") from None
    kind = whole.get("type") if isinstance(whole, dict) else None
    if kind != "FeatureCollection" or not isinstance(whole.get("features"), list):
        raise InputError(f"{file}: must be a FeatureCollection, whose features are Points")
    points, places = [], []
    for number, feature in enumerate(whole["features"], start=1):
        where = f"{file}: feature {number}"
        points.append(_feature(feature, where))
        places.append(where)
    return _node_file(True, points, places)  # noqa: FBT003


def _feature(feature: Any, where: str) -> list[float]:
    """Latitude, longitude and depth: that of the properties, or minus the third coordinate."""
    geometry = feature.get("geometry") if isinstance(feature, Mapping) else None
    if not isinstance(geometry, Mapping) or geometry.get("type") != "Point":
        found = geometry.get("type") if isinstance(geometry, Mapping) else geometry
        raise InputError(f"{where}: must be a Point, not {short(found)}")
    coordinates, properties = geometry.get("coordinates"), feature.get("properties")
    if not isinstance(coordinates, list) or not 2 <= len(coordinates) <= 3:
        raise InputError(f"{where}: coordinates must be [longitude, latitude, height]")
    if not isinstance(properties, Mapping | None):
        raise InputError(f"{where}: properties: must be an object or null, not {short(properties)}")
    depths = [v for k, v in (properties or {}).items() if _plain(k) in _NAMES["depth"]]
    if len(depths) > 1:
        raise InputError(f"{where}: properties: has two depths")
    if not depths and len(coordinates) == 2:
        raise InputError(
            f"{where}: has no depth, neither in its properties nor as minus its height"
        )
    depth = depths[0] if depths else coordinates[2]
    found = [
        _number(coordinates[1], "latitude", f"{where}: latitude"),
        _number(coordinates[0], "longitude", f"{where}: longitude"),
    ]
    if depths:
        return [*found, _number(depth, "depth", f"{where}: depth")]
    height = depth if not is_number(depth) else 0.0 - depth
    return [*found, _number(height, "depth", f"{where}: minus the height")]


def _number(given: Any, meaning: str, where: str) -> float:
    """A number from a file.

    Raises:
        InputError: it is none, or cannot be that of a node.
    """
    value = given
    if isinstance(given, str):
        try:
            value = float(given)
        except ValueError:
            value = None
    if not is_number(value):
        raise InputError(f"{where}: must be a number, not {short(given)}")
    number = float(value)
    if meaning == "depth" and number < 0:
        raise InputError(f"{where}: {number:g} m is above the surface; depths point down")
    if abs(number) > _LIMITS[meaning]:
        limit = f"{_LIMITS[meaning]:g}"
        raise InputError(f"{where}: must be at most {limit} on either side of 0, not {number:g}")
    return number


def _node_file(is_on_earth: bool, points: list[list[float]], places: list[str]) -> NodeFile:  # noqa: FBT001
    found = np.array(points, dtype=np.float64).reshape(-1, 3)
    return NodeFile(is_on_earth, found, tuple(places))
