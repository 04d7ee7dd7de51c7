"""Settings as layers: read, merged, and every value traced to where it was written.

A layer lies over another one: mappings merge key by key, all else replaces. Two things follow:

- A part whose `kind` changes starts from that kind's defaults.
- Where a layer lists cells and a layer below counts them (`nodes.cells` over `nodes.count`,
  `auvs.start_cells` over `auvs.count`), a count of others no longer holds: all are meant. A
  count above its list, or beside it in one layer, holds: the first so many are meant. Of AUVs a
  count may be larger than its list, and then holds: the others start where there is room.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

from iout_marl.errors import InputError
from iout_marl.files import note_input
from iout_marl.scenario.places import KeyPath, Places, shorten, show_file, show_path, show_value
from iout_marl.scenario.plain import plain_mapping, plain_value
from iout_marl.scenario.sources import find_scenario
from iout_marl.scenario.yaml_values import MAX_BYTES, MAX_DEPTH, read_yaml

__all__ = [
    "KeyPath",
    "Layer",
    "Overrides",
    "mapping_layer",
    "overrides_layer",
    "parse_file",
    "pop_bases",
    "read_file",
    "read_with_bases",
    "show_file",
    "show_path",
]

#: Lists, and the key beside each that says how many of its entries are meant.
_COUNTED = {("nodes", "cells"): "count", ("auvs", "start_cells"): "count"}
#: Of these the count may be larger than the list.
_CONTINUED = {("auvs", "start_cells")}
#: Scenarios that one may extend, those that they extend among them.
MAX_BASES = 50


@dataclass
class Layer:
    """Settings, and where each of them was written.

    Attributes:
        data: nested mappings, lists and scalars.
        places: for the path of every key and list item, `file:line` or the override
            that wrote it.
    """

    data: dict[str, Any] = field(default_factory=dict)
    places: Places = field(default_factory=Places)

    def origin(self, path: KeyPath) -> str:
        """Where `path` was written, or else the nearest key above it."""
        return self.places.nearest(path) or "scenario"

    def over(self, base: Layer) -> Layer:
        """This layer's settings over those of `base`; both stay as they are."""
        merged = Layer()
        for layer in (base, self):
            _merge(merged.data, layer.data, merged.places, layer.places, ())
        return merged

    def below(self, key: str) -> Layer:
        """The layer as the part of that name of another one."""
        return Layer({key: self.data}, Places(inside={key: self.places}))


#: What is laid over a scenario.
Overrides: TypeAlias = str | Iterable[object] | Mapping[str, Any] | Layer | None


def _still_holds(path: KeyPath, count: Any, cells: Any) -> bool:
    """Whether a count from below fits the list above it; wrong types are the schema's matter."""
    if not isinstance(count, int) or not isinstance(cells, list):
        return False
    return count == len(cells) or (path in _CONTINUED and count > len(cells))


def _merge(
    base: dict[str, Any],
    upper: Mapping[str, Any],
    base_places: Places,
    upper_places: Places,
    path: KeyPath,
    *,
    is_one_layer: bool = False,
) -> None:
    """Lay `upper` over `base`, whose mappings and places are changed."""
    base_places.where = upper_places.where or base_places.where
    if not is_one_layer:
        for listed, count in _COUNTED.items():
            is_listed = path == listed[:-1] and listed[-1] in upper and count not in upper
            if is_listed and not _still_holds(listed, base.get(count), upper[listed[-1]]):
                base.pop(count, None)
                base_places.inside.pop(count, None)
    for key, value in upper.items():
        old, places = base.get(key), upper_places.inside.get(key, Places())
        if not isinstance(value, dict):
            base[key], base_places.inside[key] = value, places
            continue
        kind_changes = (
            isinstance(old, dict)
            and "kind" in value
            and value["kind"] != old.get("kind", value["kind"])
        )
        if kind_changes or not isinstance(old, dict):
            base[key], base_places.inside[key] = {}, Places()
        inside = base_places.inside.setdefault(key, Places())
        _merge(base[key], value, inside, places, (*path, key), is_one_layer=is_one_layer)


def read_file(path: Path) -> Layer:
    """One YAML file as a layer, without what it extends.

    Raises:
        InputError: the file cannot be read, is not YAML, or is not a mapping.
    """
    try:
        with path.open("rb") as file:
            note_input(file.fileno())
            contents = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise InputError(f"{show_file(path)}: cannot be read: {error.strerror}") from None
    return parse_file(path, contents)


def parse_file(path: Path, contents: bytes) -> Layer:
    """`read_file` for a file whose contents are known.

    Raises:
        InputError: they are not YAML, or not a mapping.
    """
    name = show_file(path)
    if len(contents) > MAX_BYTES:
        raise InputError(f"{name}: cannot be read: larger than {MAX_BYTES:,} bytes")
    try:
        text = contents.decode("utf-8-sig")
    except UnicodeDecodeError:
        is_wide = contents.startswith((b"\xff\xfe", b"\xfe\xff"))
        what = "not UTF-8 text" + (", but UTF-16: save it as UTF-8" if is_wide else "")
        raise InputError(f"{name}: cannot be read: {what}") from None
    data, places = read_yaml(text, name)
    places.where = name
    if data is None:
        return Layer({}, places)
    if not isinstance(data, dict):
        raise InputError(f"{name}:1: must be a mapping of keys to values")
    return Layer(data, places)


def read_with_bases(source: str | Path, beside: Path | None = None) -> Layer:
    """A scenario's file over all that it extends, the first base at the bottom.

    Raises:
        InputError: as `read_file`; a base is missing; a scenario extends itself, or too many.
    """
    return _Chain().read(find_scenario(source, beside), ())


def mapping_layer(source: Mapping[Any, Any]) -> Layer:
    """A mapping with the keys of a file, over all that it extends.

    Raises:
        InputError: as `read_with_bases`, or its keys or values are none that a file could hold.
    """
    where = "mapping"
    data = plain_mapping(source, where)
    merged = _Chain().read_bases(pop_bases(data, where), where, None, ())
    return Layer(data, Places.throughout(data, where)).over(merged)


class _Chain:
    """Reads scenarios and what they extend, each file once."""

    def __init__(self) -> None:
        self._read: dict[Path, Layer] = {}
        self._num_bases = 0

    def read(self, path: Path, below: tuple[Path, ...]) -> Layer:
        """A file over its bases; `below` are the files that led to it."""
        resolved = path.resolve()
        if resolved not in self._read:
            layer = read_file(path)
            where = layer.origin(("extends",))
            bases = pop_bases(layer.data, where)
            merged = self.read_bases(bases, where, path, (*below, resolved))
            self._read[resolved] = layer.over(merged)
        return self._read[resolved]

    def read_bases(
        self, bases: list[str], where: str, beside: Path | None, below: tuple[Path, ...]
    ) -> Layer:
        """Bases by name or path, the first at the bottom."""
        merged = Layer()
        for base in bases:
            self._num_bases += 1
            if self._num_bases > MAX_BASES:
                raise InputError(f"{where}: extends: more than {MAX_BASES} scenarios in all")
            try:
                path = find_scenario(base, beside)
            except InputError as error:
                raise InputError(f"{where}: extends: {error}") from None
            if path.resolve() in below:
                circle = " → ".join(shorten(p.stem) for p in (*below, path))
                raise InputError(f"{where}: extends: a scenario must not extend itself ({circle})")
            layer = self.read(path, below)
            _merge(merged.data, layer.data, merged.places, layer.places, ())
        return merged


def pop_bases(data: dict[str, Any], where: str) -> list[str]:
    """Take `extends` out of a scenario's settings.

    Raises:
        InputError: it is no name, path or list of them.
    """
    bases = data.pop("extends", [])
    bases = [bases] if isinstance(bases, str) else bases
    if not isinstance(bases, list) or not all(isinstance(b, str) for b in bases):
        raise InputError(f"{where}: extends: must be a scenario's name or path, or a list of them")
    return bases


def overrides_layer(overrides: Overrides) -> Layer:
    """Dotted overrides as one layer, later ones over earlier ones.

    Args:
        overrides: `{"auvs.count": 3}`, `["auvs.count=3"]` or `"auvs.count=3"`, with values in
            YAML; a layer stays as it is.

    Raises:
        InputError: an override is not of the form `key=value`, or its value is no YAML.
    """
    if isinstance(overrides, Layer):
        return overrides
    merged = Layer()
    for key, value, where, written in _pairs(overrides):
        keys = key.split(".")
        if not all(keys) or len(keys) > MAX_DEPTH:
            raise InputError(f"{where}: the key must be dotted words, such as auvs.count")
        if keys[0] == "extends":
            raise InputError(f"{where}: extends cannot be overridden: name the scenario itself")
        data, places = value, written
        for part in reversed(keys):
            data, places = {part: data}, Places(where, {part: places})
        places.where = ""
        _merge(merged.data, data, merged.places, places, (), is_one_layer=True)
    return merged


def _pairs(
    overrides: str | Iterable[object] | Mapping[str, Any] | None,
) -> Iterable[tuple[str, Any, str, Places]]:
    """Key, value, what the override is called, and places in the value."""
    if isinstance(overrides, Mapping):
        for key, value in overrides.items():
            if not isinstance(key, str):
                raise InputError(f"override {show_value(key)}: keys are words, such as auvs.count")
            where = f"override {shorten(key)}"
            data = plain_value(value, where)
            yield str(key), data, where, Places.throughout(data, where)
        return
    texts = [overrides] if isinstance(overrides, str) else overrides
    if texts is None:
        return
    if isinstance(texts, bytes) or not isinstance(texts, Iterable):
        raise InputError(f"overrides: must be key=value or a mapping, not {show_value(texts)}")
    for text in texts:
        if not isinstance(text, str):
            raise InputError(f"override {show_value(text)}: must be of the form key=value")
        key, equals, value = text.partition("=")
        where = f"--set {text if len(text) <= 100 else text[:97] + '...'}"
        if not equals or not key:
            raise InputError(f"{where}: must be of the form key=value")
        data, places = read_yaml(value, where, is_file=False)
        yield key.strip(), data, where, places
