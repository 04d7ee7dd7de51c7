"""YAML files as layers: read, merged, and every value traced to its file and line."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.scalarbool import ScalarBoolean

from iout_marl.errors import InputError
from iout_marl.scenario.sources import find_scenario

#: A key's way down from the top of the scenario: names and list indices.
KeyPath = tuple[str | int, ...]
#: More values than any scenario has. Aliases of aliases would multiply without end.
MAX_VALUES = 100_000


def show_path(path: KeyPath) -> str:
    """`nodes.cells[2]` for ("nodes", "cells", 2)."""
    text = ""
    for key in path:
        text += f"[{key}]" if isinstance(key, int) else f".{key}" if text else str(key)
    return text


def show_file(path: Path) -> str:
    """The shorter of a file's path as given and its path from here."""
    relative = os.path.relpath(path)
    return relative if len(relative) < len(str(path)) else str(path)


@dataclass
class Layer:
    """Settings, and where each of them was written.

    Attributes:
        data: nested mappings, lists and scalars.
        origins: for the path of every key and list item, `file:line` or the override
            that wrote it.
    """

    data: dict[str, Any] = field(default_factory=dict)
    origins: dict[KeyPath, str] = field(default_factory=dict)

    def origin(self, path: KeyPath) -> str:
        """Where `path` was written, or else the nearest key above it."""
        for end in range(len(path), -1, -1):
            if path[:end] in self.origins:
                return self.origins[path[:end]]
        return "scenario"

    def over(self, base: Layer) -> Layer:
        """This layer's settings over those of `base`.

        Mappings merge key by key, all else replaces. A part whose `kind` changes
        starts from that kind's defaults: the keys of the other kind mean nothing to it.
        """
        merged = Layer(dict(base.data), dict(base.origins))
        _merge(merged.data, self.data, (), merged.origins, self.origins)
        return merged


def _merge(
    base: dict[str, Any],
    upper: Mapping[str, Any],
    path: KeyPath,
    origins: dict[KeyPath, str],
    upper_origins: Mapping[KeyPath, str],
) -> None:
    if path in upper_origins:
        origins[path] = upper_origins[path]
    for key, value in upper.items():
        here = (*path, key)
        old = base.get(key)
        if isinstance(old, dict) and isinstance(value, dict):
            kind_changes = "kind" in value and value["kind"] != old.get("kind", value["kind"])
            if kind_changes:
                _forget(origins, here)
            base[key] = {} if kind_changes else dict(old)
            _merge(base[key], value, here, origins, upper_origins)
        else:
            base[key] = value
            _forget(origins, here)
            origins |= {p: o for p, o in upper_origins.items() if p[: len(here)] == here}


def _forget(origins: dict[KeyPath, str], path: KeyPath) -> None:
    for place in [p for p in origins if p[: len(path)] == path]:
        del origins[place]


def read_file(path: Path) -> Layer:
    """One YAML file as a layer, without what it extends.

    Raises:
        InputError: the file cannot be read, is not YAML, or is not a mapping.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{show_file(path)}: cannot be read: {error.strerror}") from None
    return parse_file(path, data)


def parse_file(path: Path, contents: bytes) -> Layer:
    """`read_file` for a file whose contents are known.

    Raises:
        InputError: they are not YAML, or not a mapping.
    """
    name = show_file(path)
    try:
        text = contents.decode()
    except UnicodeDecodeError:
        raise InputError(f"{name}: cannot be read: not UTF-8 text") from None
    origins: dict[KeyPath, str] = {(): name}
    data = _values(text, name, origins)
    if data is None:
        return Layer({}, origins)
    if not isinstance(data, dict):
        raise InputError(f"{name}:1: must be a mapping of keys to values")
    return Layer(data, origins)


def _values(text: str, name: str, origins: dict[KeyPath, str]) -> Any:
    """What a YAML text says, in plain Python values; its line numbers go to `origins`."""
    try:
        return _plain(_parse(text, name), (), name, origins)
    except RecursionError:
        raise InputError(f"{name}: broken YAML: nested too deeply, or within itself") from None


def _parse(text: str, name: str) -> Any:
    # YAML 1.2, in which 1e-3 is a number; round-trip mode keeps the line numbers.
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of what is odd, but allowed
            return YAML(typ="rt", pure=True).load(text)
    except RecursionError:
        raise
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f":{mark.line + 1}" if mark and "\n" in text else ""
        problem = (error.problem or error.context or "malformed").splitlines()[0]
        raise InputError(f"{name}{line}: broken YAML: {problem}") from None
    except YAMLError as error:
        first_line = str(error).strip().splitlines()[0]
        raise InputError(f"{name}: broken YAML: {first_line}") from None
    except Exception as error:
        # ruamel.yaml lets through whatever it meets in dates, numbers and tags.
        raise InputError(f"{name}: broken YAML: {error}") from None


def _plain(node: Any, path: KeyPath, name: str, origins: dict[KeyPath, str]) -> Any:
    """ruamel's annotated tree as plain Python values; its line numbers go to `origins`."""
    if len(origins) > MAX_VALUES:
        raise InputError(f"{name}: broken YAML: more than {MAX_VALUES:,} values")
    if isinstance(node, CommentedMap):
        result = {}
        for key, value in node.items():
            if not isinstance(key, str):
                line = node.lc.key(key)[0] + 1
                raise InputError(f"{name}:{line}: {key!r} is no key: keys are words")
            # Keys that came by a YAML merge (`<<`) have no position of their own.
            position = node.lc.data.get(key) if node.lc.data else None
            line = (position[0] if position else node.lc.line) + 1
            origins[(*path, key)] = f"{name}:{line}"
            result[key] = _plain(value, (*path, key), name, origins)
        return result
    if isinstance(node, CommentedSeq):
        for i in range(len(node)):
            origins[(*path, i)] = f"{name}:{node.lc.item(i)[0] + 1}"
        return [_plain(value, (*path, i), name, origins) for i, value in enumerate(node)]
    if isinstance(node, bool | ScalarBoolean):
        return bool(node)
    for scalar in (int, float, str):
        if isinstance(node, scalar):
            return scalar(node)  # ruamel's own scalars keep their spelling
    return node


def read_with_bases(source: str | Path, beside: Path | None = None) -> Layer:
    """A scenario's file over all that it extends, the first base at the bottom.

    Raises:
        InputError: as `read_file`; a base is missing; a scenario extends itself.
    """
    path = find_scenario(source, beside)
    return _read_chain(path, ())


def _read_chain(path: Path, below: tuple[Path, ...]) -> Layer:
    layer = read_file(path)
    where = layer.origin(("extends",))
    bases = pop_bases(layer.data, where)
    below = (*below, path.resolve())
    merged = Layer()
    for base in bases:
        try:
            base_path = find_scenario(base, beside=path)
        except InputError as error:
            raise InputError(f"{where}: extends: {error}") from None
        if base_path.resolve() in below:
            circle = " → ".join(p.stem for p in (*below, base_path))
            raise InputError(f"{where}: extends: a scenario must not extend itself ({circle})")
        merged = _read_chain(base_path, below).over(merged)
    return layer.over(merged)


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


def overrides_layer(overrides: Iterable[str] | Mapping[str, Any]) -> Layer:
    """Dotted overrides as a layer.

    Args:
        overrides: `{"auvs.count": 3}`, or `["auvs.count=3"]` with values in YAML.

    Raises:
        InputError: an override is not of the form `key=value`, or its value is no YAML.
    """
    merged = Layer()
    for key, value, origin in _pairs(overrides):
        keys = tuple(key.split("."))
        if not all(keys):
            raise InputError(f"{origin}: the key must be dotted words, such as auvs.count")
        data: Any = value
        for part in reversed(keys):
            data = {part: data}
        origins: dict[KeyPath, str] = {keys[:i]: origin for i in range(1, len(keys) + 1)}
        merged = Layer(data, origins).over(merged)
    return merged


def _pairs(overrides: Iterable[str] | Mapping[str, Any]) -> Iterable[tuple[str, Any, str]]:
    if isinstance(overrides, Mapping):
        for key, value in overrides.items():
            yield key, value, f"override {key}"
        return
    for text in overrides:
        key, equals, value = text.partition("=")
        origin = f"--set {text}"
        if not equals or not key:
            raise InputError(f"{origin}: must be of the form key=value")
        yield key.strip(), _values(value, origin, {}), origin
