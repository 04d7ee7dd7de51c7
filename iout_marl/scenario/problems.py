"""What is wrong with settings, in one line: where, what, and what was meant."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from iout_marl.errors import InputError, did_you_mean
from iout_marl.outside import load_entry_points
from iout_marl.scenario.files_named import with_files_read
from iout_marl.scenario.hints import hint_to_key
from iout_marl.scenario.keys import Unknown, all_keys, key_of, unknown_keys
from iout_marl.scenario.layers import Layer
from iout_marl.scenario.parts import bring_up_to_date
from iout_marl.scenario.places import KeyPath, shorten, show_path, show_value
from iout_marl.scenario.sources import bundled_root
from iout_marl.words import listed

Model = TypeVar("Model", bound=BaseModel)
#: Unknown keys that a message describes; of more it gives the number.
MAX_DESCRIBED = 8
#: Words of older YAML for booleans, which are none in YAML 1.2.
_BOOLEANS = {
    **dict.fromkeys(("yes", "on", "y", "true", "1"), "true"),
    **dict.fromkeys(("no", "off", "n", "false", "0"), "false"),
}


def validate(model: type[Model], layer: Layer, *, if_missing: str = "") -> Model:
    """A layer's settings as a checked model.

    Args:
        model: of what.
        layer: the settings.
        if_missing: what an error says at its end where one of the whole's own keys is missing.

    Raises:
        InputError: one line with file, line, key and what was meant.
    """
    load_entry_points()
    bring_up_to_date()
    try:
        return model.model_validate(with_files_read(model, layer))
    except ValidationError as error:
        # Models allow none of them, but name one at a time.
        if unknown := _describe_unknown(model, unknown_keys((model,), layer.data), layer):
            raise InputError(unknown) from None
        problems = error.errors(include_url=False)
        more = f" (and {len(problems) - 1:,} more)" if len(problems) > 1 else ""
        is_missing = problems[0]["type"] == "missing" and len(problems[0]["loc"]) == 1
        hint = if_missing if is_missing else ""
        raise InputError(_describe(problems[0], layer) + more + hint) from None


def refuse_unknown(model: type[BaseModel], layer: Layer) -> None:
    """Refuse keys that a file cannot have, whatever it is laid over.

    Raises:
        InputError: one line with file, line, key and what was meant.
    """
    keys = (key for key in unknown_keys((model,), layer.data) if not key.other_kinds)
    if unknown := _describe_unknown(model, keys, layer):
        raise InputError(unknown)


def _describe_unknown(model: type[BaseModel], keys: Iterator[Unknown], layer: Layer) -> str:
    """All keys that a file has and its sections have not, in one line; "" if there are none."""
    shown = [
        f"{layer.origin(key.path)}: {show_path(key.path)}: unknown key"
        + _hint(model, key, or_list=i == 0)
        for i, key in enumerate(itertools.islice(keys, MAX_DESCRIBED))
    ]
    more = sum(1 for _ in keys)
    return "; also ".join(shown) + (f"; … and {more:,} more" if more else "")


def _hint(model: type[BaseModel], unknown: Unknown, *, or_list: bool) -> str:
    key, own = str(unknown.path[-1]), unknown.model.model_fields
    if unknown.other_kinds:
        kinds = listed(list(map(repr, unknown.other_kinds)))
        return f" of kind {unknown.kind!r}: it belongs to kind {kinds}"
    if key in ("extends", "matrix"):
        return f": {key} stands at the top of a file"
    if "." in key and key in all_keys(model):
        section, _, rest = key.partition(".")
        return f": in a file it is written {section}: {{{rest.replace('.', ': {')}: …}}"
    return hint_to_key(model, key_of(unknown.path[:-1]), own, key, or_list=or_list)


def _describe(problem: ErrorDetails, layer: Layer) -> str:
    """One of pydantic's errors: its place, its key, and what must be there."""
    context = problem.get("ctx", {})
    path = (*_without_tags(problem["loc"], layer.data), *context.get("path", ()))
    message = problem["msg"]
    kind = problem["type"]
    given = problem["input"]
    if kind == "missing":
        message = "is missing"
    elif kind == "union_tag_not_found":
        path, message = (*path, "kind"), "is missing"
    elif kind == "union_tag_invalid":
        tags = [tag.strip(" '") for tag in context["expected_tags"].split(",")]
        path = path if isinstance(_at(layer.data, path), str) else (*path, "kind")
        message = unknown_kind(str(context["tag"]), tags)
    elif kind == "literal_error":
        choices = [c.strip(" '") for c in context["expected"].replace(" or ", ",").split(",")]
        message = f"unknown value {show_value(given)}"
        message += did_you_mean(shorten(given) if isinstance(given, str) else "", choices)
    elif kind in ("value_error", "assertion_error"):
        message = str(context["error"])
    elif kind == "string_unicode":
        message = "holds half a character, such as \\ud800"
    elif kind == "finite_number":
        message = f"must be a finite number, not {given}"
    elif kind == "tuple_type":
        message = f"must be a list, not {show_value(given)}"
    elif kind == "too_short":
        message = f"must list at least {context['min_length']}, not {context['actual_length']}"
    elif kind == "too_long":
        length = len(given) if isinstance(given, list | tuple) else context["actual_length"]
        message = f"must list at most {context['max_length']:,}, not {length:,}"
    elif kind == "string_too_long":
        message = f"must have at most {context['max_length']:,} characters, not {len(given):,}"
    elif kind in ("model_type", "model_attributes_type", "dict_type"):
        message = f"must be a mapping of keys to values, not {show_value(given)}"
    elif kind != "invalid":
        message = f"{message.replace('Input should', 'must')}, not {show_value(given)}"
        message += _what_was_meant(kind, given)
    where = layer.origin(path)
    beside: KeyPath = context.get("beside") or path
    other = layer.origin(beside)
    if other == where:
        return f"{where}: {show_path(path)}: {message}"
    if _is_bundled(path, layer) and not _is_bundled(beside, layer):
        # Of the two only the other one stands where the user can write.
        return f"{other}: {show_path(beside)}: set {key_of(path)} beside it: {message} ({where})"
    return f"{where}: {show_path(path)}: {message} ({show_path(beside)}: {other})"


def unknown_kind(kind: str, known: Sequence[str]) -> str:
    """What is said of a kind of part that there is not."""
    near = did_you_mean(shorten(kind), known, or_list=False)
    return (
        f"unknown kind {show_value(kind)}{near or ';'} known: {', '.join(known)}; "
        "parts from outside need --import"
    )


def _is_bundled(path: KeyPath, layer: Layer) -> bool:
    """Whether a key was written in a file that comes with the package."""
    file = layer.places.file_of(path)
    return file is not None and file.resolve().is_relative_to(bundled_root().resolve())


def _what_was_meant(kind: str, given: Any) -> str:
    """A hint to a value of the right type, for one that YAML reads as another."""
    if kind.startswith("bool") and (isinstance(given, str | int | float)):
        word = _BOOLEANS.get(str(given).lower())
        return f"; did you mean {word}?" if word else ""
    if kind.startswith("string") and isinstance(given, bool | int | float):
        return f'; write it in quotes: "{show_value(given)}"'
    if kind.startswith(("int", "float")) and isinstance(given, str):
        number = given.strip().replace("_", "")
        try:
            if not math.isfinite(float(number)):
                return "; it must be finite"
        except ValueError:
            is_measure = number[:1].isdigit() and number[-1:].isalpha()
            return "; write the number alone: its unit is in the key" if is_measure else ""
        return f"; write it without quotes: {shorten(number)}"
    return ""


def _at(data: Any, path: KeyPath) -> Any:
    """What stands at a path; None where nothing does."""
    for key in path:
        if isinstance(data, list) and isinstance(key, int) and key < len(data):
            data = data[key]
        else:
            data = data.get(key) if isinstance(data, dict) else None
    return data


def _without_tags(location: tuple[str | int, ...], data: Any) -> KeyPath:
    """pydantic's location of an error without what it puts behind a key of several forms.

    That is the kind of a part, or a word in parentheses.
    """
    path: list[str | int] = []
    kind_is_over = False
    for key in location:
        # Once: a kind may have a key of its own name.
        if isinstance(data, dict) and data.get("kind") == key and not kind_is_over:
            kind_is_over = True
            continue
        # A part named by a word alone: what follows is its kind.
        if isinstance(data, str):
            data = None
            continue
        if isinstance(key, str) and key.startswith("("):
            continue
        path.append(key)
        kind_is_over = False
        if isinstance(data, dict):
            data = data.get(str(key))
        elif isinstance(data, list) and isinstance(key, int) and key < len(data):
            data = data[key]
        else:
            data = None
    return tuple(path)
