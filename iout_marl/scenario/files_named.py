"""Which keys of a layer name files of data: those are read before the rest is checked.

Validators know nothing of the file in which a value stands, so paths are followed here, by the
annotations of the keys.
"""

from __future__ import annotations

import copy
import types
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from iout_marl.errors import InputError
from iout_marl.registry import on_change
from iout_marl.scenario.data_files import DataFile
from iout_marl.scenario.layers import Layer
from iout_marl.scenario.parts import PartOf
from iout_marl.scenario.places import KeyPath, show_path


def with_files_read(model: type[BaseModel], layer: Layer) -> dict[str, Any]:
    """A layer's data, with every file of data that it names in the place of its path.

    Raises:
        InputError: one cannot be read: one line with where it is named, by which key, and why.
    """
    found = list(_files(model, layer.data, ()))
    if not found:
        return layer.data
    data = copy.deepcopy(layer.data)
    for path, value in found:
        # A path with its digest is written in the file of the path.
        own = (*path, "path") if isinstance(value, Mapping) else path
        try:
            file = DataFile.from_value(value, layer.places.file_of(own))
        except InputError as error:
            raise InputError(f"{layer.origin(own)}: {show_path(path)}: {error}") from None
        parent: Any = data
        for key in path[:-1]:
            parent = parent[key]
        parent[path[-1]] = file
    return data


def _files(annotation: Any, value: Any, path: KeyPath) -> Iterator[tuple[KeyPath, Any]]:
    """Paths of files, as they are written, in a value of a type, and where they stand."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if annotation is DataFile:
        if isinstance(value, str | Mapping):
            yield path, value
    elif origin is Annotated:
        part = next((mark for mark in annotation.__metadata__ if isinstance(mark, PartOf)), None)
        yield from _files_of_part(part, value, path) if part else _files(arguments[0], value, path)
    elif isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield from _files_of_section(annotation, value, path)
    elif origin in (Union, types.UnionType):
        for each in arguments:
            yield from _files(each, value, path)
    elif origin in (tuple, list) and isinstance(value, list | tuple):
        is_one_type = origin is list or arguments[1:] == (Ellipsis,)
        for i, item in enumerate(value):
            if is_one_type or i < len(arguments):
                yield from _files(arguments[0 if is_one_type else i], item, (*path, i))
    elif origin is dict and isinstance(value, Mapping):
        for key, item in value.items():
            yield from _files(arguments[1], item, (*path, key))


def _files_of_part(part: PartOf, value: Any, path: KeyPath) -> Iterator[tuple[KeyPath, Any]]:
    if isinstance(value, Mapping):
        kind = value.get("kind", part.default)
        for model in part.models():
            if model.entry.kind == kind:
                yield from _files_of_section(model, value, path)


def _files_of_section(
    model: type[BaseModel], value: Any, path: KeyPath
) -> Iterator[tuple[KeyPath, Any]]:
    if isinstance(value, Mapping):
        for key, annotation in _fields(model).items():
            if key in value:
                yield from _files(annotation, value[key], (*path, key))


@cache
def _fields(model: type[BaseModel]) -> Mapping[str, Any]:
    """The types of a section's fields that may hold files of data, or sections that do."""
    fields = {name: _whole(field) for name, field in model.model_fields.items()}
    return {name: each for name, each in fields.items() if _may_hold(each, frozenset([model]))}


def _whole(field: FieldInfo) -> Any:
    """A field's type with what it is annotated with."""
    return Annotated[(field.annotation, *field.metadata)] if field.metadata else field.annotation


def _may_hold(annotation: Any, above: frozenset[type[BaseModel]]) -> bool:
    """Whether there may be files of data in a value of a type within some sections."""
    if annotation is DataFile:
        return True
    models: tuple[type[BaseModel], ...] = ()
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        models = (annotation,)
    for mark in getattr(annotation, "__metadata__", ()):
        if isinstance(mark, PartOf):
            models = mark.models()
    return any(_may_hold(each, above) for each in get_args(annotation)) or any(
        _may_hold(_whole(field), above | {model})
        for model in set(models) - above
        for field in model.model_fields.values()
    )


on_change.append(lambda _: _fields.cache_clear())
