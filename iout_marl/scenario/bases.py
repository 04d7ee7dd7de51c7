"""A scenario over all that it extends: files, members of families, and mappings."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from iout_marl.errors import InputError
from iout_marl.scenario.layers import Layer, parse_file, read_contents
from iout_marl.scenario.naming import family_in, find_scenario, split_member
from iout_marl.scenario.parts import part_of
from iout_marl.scenario.places import KeyPath, Places, shorten, show_file, show_path
from iout_marl.scenario.plain import plain_mapping
from iout_marl.scenario.schema import Scenario
from iout_marl.scenario.sources import without_suffix

#: Scenarios that one may extend, those that they extend among them.
MAX_BASES = 50
#: What a scenario that another one trains over has for itself alone.
NOT_OF_FAMILIES = ("training", "observation", "name", "description")


def read_with_bases(path: Path) -> Layer:
    """A scenario that was found, over all that it extends, the first base at the bottom.

    Raises:
        InputError: as `read_file`; a base is missing; a scenario extends itself, or too many.
    """
    return _Chain().read(path, ())


def mapping_layer(source: Mapping[Any, Any], beside: Path | None = None) -> Layer:
    """A mapping with the keys of a file, over all that it extends.

    Args:
        source: the mapping.
        beside: the file in which it stands; None for the working folder.

    Raises:
        InputError: as `read_with_bases`, or its keys or values are none that a file could hold.
    """
    where = "mapping"
    data = plain_mapping(source, where)
    merged = _Chain().read_bases(data, pop_bases(data, where), where, beside, ())
    return Layer(data, Places.throughout(data, where)).over(merged)


def with_over_read(layer: Layer) -> Layer:
    """A layer with the settings of each scenario that `training.over` names, in its place.

    Raises:
        InputError: one is not there, or as `read_with_bases`.
    """
    training = layer.data.get("training")
    if not isinstance(training, dict) or not isinstance(training.get("over"), list):
        return layer
    entries = []
    for i, written in enumerate(training["over"]):
        is_name = isinstance(written, str)
        entry = {"scenario": written} if is_name else written
        if isinstance(entry, dict) and isinstance(entry.get("scenario"), str | dict):
            path = ("training", "over", i, *(() if is_name else ("scenario",)))
            entry = _over_read(entry, layer, path)
        entries.append(entry)
    data = {**layer.data, "training": {**training, "over": entries}}
    return Layer(data, layer.places)


def _over_read(entry: dict[str, Any], layer: Layer, path: KeyPath) -> dict[str, Any]:
    named, beside = entry["scenario"], layer.places.file_of(path)
    if isinstance(named, dict):
        if "extends" not in named:
            return entry
        return {**entry, "scenario": mapping_layer(named, beside).data}
    try:
        read = read_with_bases(find_scenario(named, beside))
    except InputError as error:
        raise InputError(f"{layer.origin(path)}: {show_path(path)}: {error}") from None
    own = {k: v for k, v in read.data.items() if k not in NOT_OF_FAMILIES}
    return {"name": named, **entry, "scenario": own}


class _Chain:
    """Reads scenarios and what they extend, each file once."""

    def __init__(self) -> None:
        self._read: dict[Path, Layer] = {}
        self._num_bases = 0

    def read(self, path: Path, below: tuple[Path, ...]) -> Layer:
        """A file, or a member of a family, over its bases; `below` are those that led to it."""
        resolved = path.resolve()
        if resolved not in self._read:
            file, name = split_member(path)
            contents = read_contents(file)
            layer = parse_file(file, contents)
            if layer.data.keys() & {"title", "groups"} and not is_scenario(layer):
                raise InputError(f"{show_file(file)}: is a study, not a scenario")
            family = family_in(file, contents)
            member = family.member(name) if family else None
            where = layer.origin(("extends",))
            bases = pop_bases(layer.data, where)
            if member:
                bases = [member.fill(base, where, "extends") for base in bases]
            merged = self.read_bases(layer.data, bases, where, file, (*below, resolved))
            self._read[resolved] = member.over(merged) if member else layer.over(merged)
        return self._read[resolved]

    def read_bases(
        self,
        data: Mapping[str, Any],
        bases: list[str],
        where: str,
        beside: Path | None,
        below: tuple[Path, ...],
    ) -> Layer:
        """What lies below some settings: their bases by name or path, the first at the bottom."""
        merged = Layer() if bases else _unnamed_kinds(data)
        for base in bases:
            self._num_bases += 1
            if self._num_bases > MAX_BASES:
                raise InputError(f"{where}: extends: more than {MAX_BASES} scenarios in all")
            try:
                path = find_scenario(base, beside)
            except InputError as error:
                raise InputError(f"{where}: extends: {error}") from None
            if path.resolve() in below:
                circle = " → ".join(shorten(without_suffix(p.name)) for p in (*below, path))
                raise InputError(f"{where}: extends: a scenario must not extend itself ({circle})")
            merged = self.read(path, below).over(merged)
        return merged


def _unnamed_kinds(data: Mapping[str, Any]) -> Layer:
    """The kinds of a file's parts where it extends nothing and names none."""
    parts = {name: part_of(field) for name, field in Scenario.model_fields.items()}
    return Layer(
        {
            name: {"kind": part.default}
            for name, part in parts.items()
            if part and part.default and isinstance(data.get(name), dict)
        }
    )


def is_scenario(layer: Layer) -> bool:
    """Whether a file has keys that only scenarios have."""
    own = {"extends", "matrix", *Scenario.model_fields} - {"description"}
    return not own.isdisjoint(layer.data)


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
