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
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeAlias

from iout_marl.errors import InputError
from iout_marl.files import note_input
from iout_marl.scenario.places import KeyPath, Places, shorten, show_file, show_path, show_value
from iout_marl.scenario.plain import plain_value
from iout_marl.scenario.yaml_values import MAX_BYTES, MAX_DEPTH, read_yaml

__all__ = [
    "KeyPath",
    "Layer",
    "Overrides",
    "overrides_layer",
    "parse_file",
    "read_file",
    "settings_layer",
    "show_file",
    "show_path",
]

#: Lists, and the key beside each that says how many of its entries are meant.
_COUNTED = {("nodes",): ("cells", "count"), ("auvs",): ("start_cells", "count")}
#: Lists whose count may be larger than they are long.
_CONTINUED = {("auvs", "start_cells")}
#: Files up to this many characters are parsed once, as long as their contents stay the same.
_MAX_KEPT = 20_000


@dataclass
class Layer:
    """Settings, and where each of them was written: layers share what lies in them.

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
        return Layer(*_merged(base.data, self.data, base.places, self.places, ()))

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


def _merged(
    base: Mapping[str, Any],
    upper: Mapping[str, Any],
    base_places: Places,
    upper_places: Places,
    path: KeyPath,
    *,
    is_one_layer: bool = False,
) -> tuple[dict[str, Any], Places]:
    """`upper` laid over `base`, with its places; what one of them has alone is not copied."""
    merged, inside = dict(base), dict(base_places.inside)
    if not is_one_layer and path in _COUNTED:
        listed, count = _COUNTED[path]
        is_listed = listed in upper and count not in upper
        if is_listed and not _still_holds((*path, listed), base.get(count), upper[listed]):
            merged.pop(count, None)
            inside.pop(count, None)
    for key, value in upper.items():
        places = upper_places.inside.get(key) or Places()
        if isinstance(value, dict):
            old, old_places = base.get(key), base_places.inside.get(key) or Places()
            if isinstance(old, str):
                # A part that is written as its kind alone.
                of_kind = Places(old_places.where, {"kind": old_places}, old_places.file)
                old, old_places = {"kind": old}, of_kind
            if not isinstance(old, dict) or (
                "kind" in value and value["kind"] != old.get("kind", value["kind"])
            ):
                old, old_places = {}, Places()
            merged[key], inside[key] = _merged(
                old, value, old_places, places, (*path, key), is_one_layer=is_one_layer
            )
        else:
            merged[key], inside[key] = value, places
    return merged, Places(upper_places.where or base_places.where, inside, base_places.file)


def read_file(path: Path) -> Layer:
    """One YAML file as a layer, without what it extends.

    Raises:
        InputError: the file cannot be read, is not YAML, or is not a mapping.
    """
    return parse_file(path, read_contents(path))


def read_contents(path: Path) -> bytes:
    """What is in a YAML file; of one that is too large only the beginning.

    Raises:
        InputError: the file cannot be read.
    """
    try:
        with path.open("rb") as file:
            note_input(file.fileno())
            return file.read(MAX_BYTES + 1)
    except OSError as error:
        raise InputError(f"{show_file(path)}: cannot be read: {error.strerror}") from None


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
    parse = _parsed_once if len(text) <= _MAX_KEPT else read_yaml
    data, places = parse(text, name)
    if data is None:
        raise InputError(f"{name}: is empty")
    if not isinstance(data, dict):
        raise InputError(f"{name}:1: must be a mapping of keys to values")
    return Layer(dict(data), Places(name, places.inside))


_parsed_once = lru_cache(maxsize=64)(read_yaml)


def overrides_layer(overrides: Overrides, file: Path | None = None) -> Layer:
    """Dotted overrides as one layer, later ones over earlier ones.

    Args:
        overrides: `{"auvs.count": 3}`, `["auvs.count=3"]` or `"auvs.count=3"`, with values in
            YAML; a layer stays as it is.
        file: where they are written, if they are: paths in them count from there.

    Raises:
        InputError: an override is not of the form `key=value`, or its value is no YAML.
    """
    return overrides if isinstance(overrides, Layer) else _layer_of(_pairs(overrides, file))


def settings_layer(settings: Mapping[str, Any], places: Places) -> Layer:
    """Settings that a file writes as overrides, by dotted keys or in sections, as one layer.

    Args:
        settings: as overrides in a mapping.
        places: where each of them was written.

    Raises:
        InputError: as by `overrides_layer`.
    """
    inside = places.inside
    return _layer_of((key, settings[key], inside[key].where, inside[key]) for key in settings)


def _layer_of(settings: Iterable[tuple[str, Any, str, Places]]) -> Layer:
    """One layer of dotted keys with their values, what each is called, and its places."""
    merged = Layer()
    for key, value, where, written in settings:
        keys = key.split(".")
        if not all(keys) or len(keys) > MAX_DEPTH:
            raise InputError(f"{where}: the key must be dotted words, such as auvs.count")
        if keys[0] == "extends":
            raise InputError(f"{where}: extends cannot be overridden: name the scenario itself")
        data, places = value, written
        for part in reversed(keys):
            data, places = {part: data}, Places(where, {part: places})
        places.where = ""
        merged = Layer(*_merged(merged.data, data, merged.places, places, (), is_one_layer=True))
    return merged


def _pairs(
    overrides: str | Iterable[object] | Mapping[str, Any] | None, file: Path | None
) -> Iterable[tuple[str, Any, str, Places]]:
    """Key, value, what the override is called, and places in the value."""
    if isinstance(overrides, Mapping):
        for key, value in overrides.items():
            if not isinstance(key, str):
                raise InputError(f"override {show_value(key)}: keys are words, such as auvs.count")
            where = f"override {shorten(key)}"
            data = plain_value(value, where)
            yield str(key), data, where, Places.throughout(data, where, str(file or ""))
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
