"""JSON Schema of scenario files, for editors: keys, descriptions, ranges and defaults at hand.

A file may say only what it changes of what it extends. So no key is required, and a part may be
written without its `kind`: then with the keys of any kind.
"""

from __future__ import annotations

from typing import Any

from iout_marl.registry import registry_of
from iout_marl.scenario.families import Matrix
from iout_marl.scenario.keys import Model, all_keys, ranges_of
from iout_marl.scenario.parts import PartOf
from iout_marl.scenario.reference import Key, keys, keys_of_kind, text_of
from iout_marl.scenario.schema import Scenario

_DIALECT = "https://json-schema.org/draft/2020-12/schema"
_EXTENDS = {
    "description": "Scenarios that this one changes, by bundled name or path, the first at the "
    "bottom.",
    "anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}}],
}


def json_schema() -> dict[str, Any]:
    """The JSON Schema, draft 2020-12, of a scenario file, with the parts that are registered."""
    definitions: dict[str, Any] = {}
    whole = _section(Scenario, definitions)
    whole["properties"]["allow_implausible"]["items"] = {"enum": sorted(ranges_of(Scenario))}
    whole["properties"] = {"extends": _EXTENDS, "matrix": _matrix(), **whole["properties"]}
    return {
        "$schema": _DIALECT,
        "title": "Scenario of iout_marl",
        **whole,
        "$defs": definitions,
    }


def _matrix() -> dict[str, Any]:
    """What makes a file a family, all of it by dotted keys as well as in sections."""
    text = {key.name: key.text for key in keys(Matrix)}
    settings = {"type": "object", "propertyNames": {"enum": sorted(all_keys(Scenario))}}
    scalar = {"not": {"anyOf": [{"type": "array"}, {"type": "object"}]}}
    case = {
        "type": "object",
        "properties": {"when": {"type": "object"}, "set": settings},
        "required": ["when", "set"],
        "additionalProperties": False,
    }
    axis = {
        "anyOf": [
            {"type": "array", "items": scalar, "minItems": 1},
            {"type": "object", "additionalProperties": settings, "minProperties": 1},
        ]
    }
    matrix = _section(Matrix, {})
    matrix["properties"] |= {
        "axes": {
            "description": text["axes"],
            "type": "object",
            "additionalProperties": axis,
            "minProperties": 1,
        },
        "cases": {"description": text["cases"], "type": "array", "items": case},
    }
    return {**matrix, "required": ["axes"]}


def _section(model: Model, definitions: dict[str, Any]) -> dict[str, Any]:
    return {
        "description": text_of(model),
        "type": "object",
        "properties": {key.name: _property(key, definitions) for key in keys(model)},
        "additionalProperties": False,
    }


def _property(key: Key, definitions: dict[str, Any]) -> dict[str, Any]:
    """What a key may hold."""
    values: dict[str, Any]
    if key.part:
        place = _part(key.part, definitions, is_item=key.is_list)
        values = {"type": "array", "items": place} if key.is_list else place
    elif len(key.sections) == 1:
        values = _section(key.sections[0], definitions)
        if key.default is None:
            values = {"anyOf": [values, {"type": "null"}]}
    elif key.sections:
        values = {"anyOf": [_section(model, definitions) for model in key.sections]}
    else:
        values = dict(key.values)
        # What a type of a user's refers to stands at the top, as all references do.
        definitions |= values.pop("$defs", {})
    if text := _description(key):
        values["description"] = text
    if key.unit:
        values["unit"] = key.unit
    if key.plausible:
        values["plausible"] = {"low": key.plausible.low, "high": key.plausible.high}
    if key.default is not ...:
        values["default"] = key.default
    return values


def _description(key: Key) -> str:
    """What a key means, with what editors would not show otherwise."""
    notes = [f"Unit: {key.unit}."] if key.unit else []
    if key.plausible:
        notes.append(f"Plausible: {key.plausible_text}.")
    return "\n\n".join(filter(None, [key.text, " ".join(notes)]))


def _part(part: PartOf, definitions: dict[str, Any], *, is_item: bool) -> dict[str, Any]:
    """A reference to what is made of the kinds of a part."""
    name = part.role.replace(" ", "_")
    if name not in definitions:
        definitions[name] = {}  # for a part that holds one of its own role
        definitions[name] = {"oneOf": _kinds(part, definitions, is_item=is_item)}
    return {"$ref": f"#/$defs/{name}"}


def _kinds(part: PartOf, definitions: dict[str, Any], *, is_item: bool) -> list[dict[str, Any]]:
    words: list[dict[str, Any]] = []
    mappings: list[dict[str, Any]] = []
    found: dict[str, list[dict[str, Any]]] = {}
    for entry in registry_of(part.role):
        about = {"title": entry.kind, "description": text_of(entry.item)}
        own = {key.name: _property(key, definitions) for key in keys_of_kind(entry)}
        for name, values in own.items():
            if values not in found.setdefault(name, []):
                found[name].append(values)
        words.append({**about, "const": entry.kind})
        mappings.append(
            {
                **about,
                "type": "object",
                "properties": {"kind": {"const": entry.kind}, **own},
                "required": ["kind"],
                "additionalProperties": False,
            }
        )
    if part.by_name:
        about = {"title": part.by_name, "description": f"`name` of kind `{part.by_name}`."}
        words.append({**about, "type": "string", "pattern": "^[A-Z]"})
    kinds = [*words, *mappings]
    # What is listed replaces whatever was listed before: nothing gives it a kind.
    return kinds if is_item else [*kinds, _of_any_kind(found)]


def _of_any_kind(found: dict[str, list[dict[str, Any]]]) -> dict[str, Any]:
    """Keys of whatever kind the file that is extended names."""
    return {
        "title": "of the kind that it has already",
        "type": "object",
        "properties": {
            name: kinds[0] if len(kinds) == 1 else {"anyOf": kinds} for name, kinds in found.items()
        },
        "not": {"required": ["kind"]},
        "additionalProperties": False,
    }
