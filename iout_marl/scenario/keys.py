"""Which keys the sections of a file have, as their fields are annotated.

What walks over a whole file at once is here: keys that are unknown, numbers that are
implausible, and which keys there are at all.
"""

from __future__ import annotations

import types
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from iout_marl.registry import on_change, registry_of
from iout_marl.scenario.fields import Plausible
from iout_marl.scenario.parts import PartOf, part_of
from iout_marl.scenario.places import KeyPath

Model = type[BaseModel]


@dataclass(frozen=True)
class Unknown:
    """A key that there is not.

    Attributes:
        path: where it was written.
        model: the section that lacks it.
        kind: the kind of the part, where there are several; else "".
        other_kinds: kinds of the same part that have it.
    """

    path: KeyPath
    model: Model
    kind: str
    other_kinds: tuple[str, ...]


def unknown_keys(
    models: tuple[Model, ...], data: Any, path: KeyPath = (), default: str = ""
) -> Iterator[Unknown]:
    """The keys in a file's data that its sections do not have, in the order of the file.

    Args:
        models: the section, or those of every kind of the part.
        data: what stands there, of any shape.
        path: where.
        default: the kind of a part that names none; empty where one must be named.
    """
    if not isinstance(data, Mapping):
        return
    named = data.get("kind", default)
    model = _of_kind(models, named)
    if model is None:
        return  # a kind that there is not is an error of its own
    fields = _fields(model)
    for key, value in data.items():
        if key in fields:
            yield from fields[key].unknown(value, (*path, key))
        else:
            having = (m for m in models if key in m.model_fields and m is not model)
            kinds = tuple(kind for other in having for kind in _kinds(other))
            kind = str(named) if len(models) > 1 else ""
            yield Unknown((*path, key), model, kind, kinds)


@dataclass(frozen=True)
class _Field:
    """What a field may hold: sections, those of a part, or sections by words."""

    sections: tuple[Model, ...]
    part: PartOf | None
    by_word: tuple[Model, ...]

    def unknown(self, value: Any, path: KeyPath) -> Iterator[Unknown]:
        """`unknown_keys` in its value."""
        if self.sections:
            completed = self.part.completed(value) if self.part else value
            default = self.part.default if self.part else ""
            yield from unknown_keys(self.sections, completed, path, default)
        elif self.by_word and isinstance(value, Mapping):
            for key, item in value.items():
                yield from unknown_keys(self.by_word, item, (*path, key))


@cache
def _fields(model: Model) -> Mapping[str, _Field]:
    found = {}
    for name, field in model.model_fields.items():
        origin, arguments = get_origin(field.annotation), get_args(field.annotation)
        by_word = _sections(arguments[1]) if origin is dict else ()
        found[name] = _Field(sections_of(field), part_of(field), by_word)
    return types.MappingProxyType(found)


def _of_kind(models: tuple[Model, ...], kind: Any) -> Model | None:
    if len(models) == 1:
        return models[0]
    return next((model for model in models if kind in _kinds(model)), None)


@cache
def _kinds(model: Model) -> tuple[str, ...]:
    field = model.model_fields.get("kind")
    return get_args(field.annotation) if field else ()


def _plain(annotation: Any) -> Any:
    """An annotation without what it is annotated with."""
    return get_args(annotation)[0] if get_origin(annotation) is Annotated else annotation


def _sections(annotation: Any) -> tuple[Model, ...]:
    """The sections that a field may hold."""
    annotation = _plain(annotation)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return (annotation,)
    if get_origin(annotation) in (Union, types.UnionType):
        return tuple(model for part in get_args(annotation) for model in _sections(part))
    return ()


def sections_of(field: FieldInfo) -> tuple[Model, ...]:
    """The sections that a field may hold: of a part those of every kind."""
    part = part_of(field)
    return part.models() if part else _sections(field.annotation)


@cache
def all_keys(model: Model) -> Mapping[str, tuple[FieldInfo, ...]]:
    """The dotted keys of a file, those of every kind of its parts, with their fields."""
    found: dict[str, tuple[FieldInfo, ...]] = {}
    for name, field in model.model_fields.items():
        found[name] = (field,)
        part = part_of(field)
        for section in sections_of(field):
            for key, fields in all_keys(section).items():
                if key == "kind" and part and part.is_word:
                    continue  # it is written as the word alone
                dotted = f"{name}.{key}"
                found[dotted] = (*found.get(dotted, ()), *fields)
    return types.MappingProxyType(found)


def takes_whole_numbers(model: Model, key: str) -> bool:
    """Whether a dotted key of a file takes whole numbers alone."""
    fields = all_keys(model).get(key, ())
    return bool(fields) and all(
        int in (plain := [_plain(p) for p in (get_args(f.annotation) or (f.annotation,))])
        and float not in plain
        for f in fields
    )


def choices(field: FieldInfo) -> tuple[Any, ...] | None:
    """The values that a field can have, where it lists them."""
    part, annotation = part_of(field), field.annotation
    if part and part.is_word:
        return registry_of(part.role).kinds
    return get_args(annotation) if get_origin(annotation) is Literal else None


@cache
def ranges(model: Model) -> Mapping[str, Plausible]:
    """The plausible ranges of a section's fields, by name; of a list, that of its items."""
    found = {}
    for name, field in model.model_fields.items():
        ranges_of_field = [m for m in field.metadata if isinstance(m, Plausible)]
        ranges_of_field += _ranges_within(field.annotation)
        if ranges_of_field:
            found[name] = ranges_of_field[0]
    return types.MappingProxyType(found)


def _ranges_within(annotation: Any) -> list[Plausible]:
    if get_origin(annotation) is Annotated:
        own = [m for m in annotation.__metadata__ if isinstance(m, Plausible)]
        return own or _ranges_within(_plain(annotation))
    return [found for part in get_args(annotation) for found in _ranges_within(part)]


def implausible(section: BaseModel, path: KeyPath = ()) -> Iterator[tuple[KeyPath, str]]:
    """Numbers of a section beyond their plausible range: where, and what is said of each."""
    own = ranges(type(section))
    for name, value in section.__dict__.items():
        if isinstance(value, BaseModel):
            yield from implausible(value, (*path, name))
        elif name in own and value is not None:
            for place, number in _numbers(value, (*path, name)):
                if not own[name].holds(number):
                    yield place, own[name].doubt(number)


def key_of(path: KeyPath) -> str:
    """The dotted key at or above a path, without places in lists."""
    return ".".join(key for key in path if isinstance(key, str))


@cache
def ranges_of(model: Model) -> frozenset[str]:
    """The dotted keys of a file that have plausible ranges."""
    found = set(ranges(model))
    for name, field in model.model_fields.items():
        for section in sections_of(field):
            found |= {f"{name}.{key}" for key in ranges_of(section)}
    return frozenset(found)


def _forget_keys(_: str) -> None:
    """Look at the sections anew: a part has come or gone."""
    for found in (all_keys, ranges_of, _fields):
        found.cache_clear()


on_change.append(_forget_keys)


def _numbers(value: Any, path: KeyPath) -> Iterator[tuple[KeyPath, float]]:
    if isinstance(value, tuple):
        for i, item in enumerate(value):
            yield from _numbers(item, (*path, i))
    else:
        yield path, value
