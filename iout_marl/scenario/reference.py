"""What a scenario file may say, as its sections and the registered parts say it themselves.

The JSON Schema for editors, the tables of `docs/scenario.md`, `iout show --explain` and `iout new`
are made from this. A key is
described by the `#:` comment above its field, a section and a kind of part by their docstrings.
"""

from __future__ import annotations

import ast
import inspect
import re
import sys
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Annotated, Any, get_args, get_origin

from pydantic import BaseModel, TypeAdapter
from pydantic.fields import FieldInfo
from pydantic_core import to_jsonable_python

from iout_marl.registry import Entry, registry_of
from iout_marl.scenario.fields import Plausible
from iout_marl.scenario.keys import Model, ranges, sections_of
from iout_marl.scenario.parts import PartOf, part_of, settings_model

#: Units by the ends of names, the longest first, where no plausible range has one.
_UNITS = {
    "_m_per_s": "m/s",
    "_bps": "bit/s",
    "_khz": "kHz",
    "_psu": "PSU",
    "_ohm": "Ω",
    "_bits": "bit",
    "_cells": "cells",
    "_slots": "slots",
    "_steps": "steps",
    "_deg": "°",
    "_db": "dB",
    "_hz": "Hz",
    "_m2": "m²",
    "_c": "°C",
    "_j": "J",
    "_m": "m",
    "_s": "s",
    "_w": "W",
}
#: What pydantic calls limits behind a validator, and what JSON Schema does.
_LIMITS = {
    "ge": "minimum",
    "gt": "exclusiveMinimum",
    "le": "maximum",
    "lt": "exclusiveMaximum",
    "min_length": "minItems",
    "max_length": "maxItems",
}
_COMMENT, _FIELD = re.compile(r"\s*#: ?(.*)"), re.compile(r"\s*(\w+)\s*:")


@dataclass(frozen=True)
class Key:
    """A key of a section or of a kind of part.

    Attributes:
        name: as it is written.
        text: what it means, in a line; empty where nothing says it.
        unit: of its number; empty for a pure number and for what is none.
        values: JSON Schema of its values; empty for a section and a part.
        plausible: the range in which its number is believed, if it has one.
        default: as a file would have it; `...` where there is none.
        sections: the sections that it may hold.
        part: the part that it holds, if it does.
        is_list: it holds a list of such parts.
    """

    name: str
    text: str
    unit: str
    values: dict[str, Any]
    plausible: Plausible | None
    default: Any
    sections: tuple[Model, ...]
    part: PartOf | None
    is_list: bool

    @property
    def range_text(self) -> str:
        """What its values can be, in words."""
        if self.sections:
            return "mapping; or `null`" if self.default is None else "mapping"
        return _in_words(self.values)

    @property
    def plausible_text(self) -> str:
        """The plausible range, in words; empty where there is none."""
        if self.plausible is None:
            return ""
        return f"{_number(self.plausible.low)} to {_number(self.plausible.high)}"


def keys(model: Model) -> tuple[Key, ...]:
    """The keys of a section, or of the settings of a kind of part, in the order of its fields."""
    texts = _comments(model)
    return tuple(
        _key(name, field, field.description or texts.get(name, ""), ranges(model).get(name))
        for name, field in model.model_fields.items()
    )


def keys_of_kind(entry: Entry[Any]) -> tuple[Key, ...]:
    """The keys of a registered kind of part, without `kind`."""
    return tuple(key for key in keys(settings_model(entry)) if key.name != "kind")


def text_of(described: Any) -> str:
    """The docstring of a section or of a kind of part; empty where it has none of its own."""
    return inspect.cleandoc(described.__doc__ or "")


def summary_of(described: Any) -> str:
    """The first paragraph of the docstring of a section or of a kind of part, in one line."""
    return " ".join(text_of(described).split("\n\n")[0].split())


def described(key: Key) -> str:
    """What a key means, its kinds or its unit and range, for plain text."""
    if key.part:
        notes = [f"kinds: {', '.join(registry_of(key.part.role).kinds)}"]
    else:
        plausible = key.plausible_text
        notes = [key.unit, key.range_text, plausible and f"plausible: {plausible}"]
    return f"{key.text} [{'; '.join(filter(None, notes))}]".strip().replace("`", "")


def _key(name: str, field: FieldInfo, text: str, plausible: Plausible | None) -> Key:
    part, listed, sections = part_of(field), _listed_part(field), sections_of(field)
    is_whole = bool(part or listed or sections)
    return Key(
        name=name,
        text=" ".join(text.split()),
        unit="" if is_whole else _unit(name, plausible),
        values={} if is_whole else _values(field),
        plausible=plausible,
        default=_default(field),
        sections=() if part else sections,
        part=part or listed,
        is_list=listed is not None,
    )


def _listed_part(field: FieldInfo) -> PartOf | None:
    """What part the items of a list are."""
    if get_origin(field.annotation) is not tuple:
        return None
    item = get_args(field.annotation)[0]
    marks = item.__metadata__ if get_origin(item) is Annotated else ()
    return next((mark for mark in marks if isinstance(mark, PartOf)), None)


def _unit(name: str, plausible: Plausible | None) -> str:
    if plausible and plausible.unit:
        return plausible.unit
    return next((unit for end, unit in _UNITS.items() if name.endswith(end)), "")


def _default(field: FieldInfo) -> Any:
    if field.is_required() or field.default_factory is not None:
        return ...
    return to_jsonable_python(field.default)


def _values(field: FieldInfo) -> dict[str, Any]:
    """JSON Schema of a field's values."""
    annotation: Any = field.annotation
    if field.metadata:
        annotation = Annotated[(annotation, *field.metadata)]
    return _tidied(TypeAdapter(annotation).json_schema())


def _tidied(schema: Any) -> Any:
    """Limits as JSON Schema calls them; plausible ranges are told apart from them."""
    if isinstance(schema, list):
        return [_tidied(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    dropped = ("title", "plausible")
    return {_LIMITS.get(k, k): _tidied(v) for k, v in schema.items() if k not in dropped}


@cache
def _comments(model: type[BaseModel]) -> dict[str, str]:
    """The `#:` comments above the fields of a model and of its bases, by field."""
    found: dict[str, str] = {}
    for base in reversed(model.__mro__):
        if not issubclass(base, BaseModel) or base is BaseModel:
            continue
        above: list[str] = []
        for line in _lines_of(base):
            if comment := _COMMENT.match(line):
                above.append(comment[1])
                continue
            if above and (field := _FIELD.match(line)):
                found[field[1]] = " ".join(above)
            above = []
    return found


def _lines_of(model: type[BaseModel]) -> list[str]:
    """The source of a class; nothing where it was made by a call, or typed and not kept."""
    try:
        # Of the class itself, `inspect` would read and parse the file each time.
        source = inspect.getsource(sys.modules[model.__module__])
    except (KeyError, OSError, TypeError):
        return []
    first, last = _classes_in(source).get(model.__qualname__, (0, 0))
    return source.splitlines()[first:last]


@lru_cache(maxsize=64)
def _classes_in(source: str) -> dict[str, tuple[int, int]]:
    """The first line, from 0, and the end of every class of a file, by its qualified name."""
    found: dict[str, tuple[int, int]] = {}

    def look(node: ast.AST, above: str) -> None:
        for inner in ast.iter_child_nodes(node):
            if isinstance(inner, ast.ClassDef):
                name = f"{above}{inner.name}"
                found.setdefault(name, (inner.lineno - 1, inner.end_lineno or 0))
                look(inner, f"{name}.")
            elif isinstance(inner, ast.FunctionDef | ast.AsyncFunctionDef):
                look(inner, f"{above}{inner.name}.<locals>.")
            else:
                look(inner, above)

    look(ast.parse(source), "")
    return found


def _in_words(values: dict[str, Any]) -> str:
    for many in ("anyOf", "oneOf"):
        if many in values:
            return "; or ".join(_in_words(one) for one in values[many])
    if "enum" in values or "const" in values:
        return ", ".join(f"`{value}`" for value in values.get("enum", [values.get("const")]))
    kind = values.get("type")
    if kind in ("number", "integer"):
        whole = ["whole"] if kind == "integer" else []
        return ", ".join(filter(None, [*whole, _limits_in_words(values)])) or "any number"
    if values.get("format") == "path":
        return "path of a file"
    if kind == "array":
        if "prefixItems" in values:
            items = values["prefixItems"]
            return f"{len(items)} numbers, each {_in_words(items[0])}"
        least, most = values.get("minItems", 0), values.get("maxItems")
        many = f" of {_number(least)} to {_number(most)}" if most else ""
        return f"list{many}, each {_in_words(values.get('items', {}))}"
    return {
        "boolean": "`true`, `false`",
        "string": "text",
        "null": "`null`",
        "object": "mapping",
    }.get(str(kind), "any")


def _limits_in_words(values: dict[str, Any]) -> str:
    words = {
        "exclusiveMinimum": "above",
        "minimum": "from",
        "exclusiveMaximum": "below",
        "maximum": "to",
    }
    return " ".join(f"{word} {_number(values[k])}" for k, word in words.items() if k in values)


def _number(value: float) -> str:
    text = f"{value:,.0f}" if value == round(value) and abs(value) < 10**7 else f"{value:g}"
    return re.sub(r"e\+?(-?)0*", r"e\1", text).replace("-", "−")
