"""From a name, a file or a mapping to a checked `Scenario`."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedSeq
from ruamel.yaml.scalarstring import DoubleQuotedScalarString

from iout_marl.errors import InputError, did_you_mean
from iout_marl.scenario.layers import (
    KeyPath,
    Layer,
    overrides_layer,
    parse_file,
    pop_bases,
    read_file,
    read_with_bases,
    show_path,
)
from iout_marl.scenario.schema import Scenario, Training
from iout_marl.scenario.sources import bundled_root, find_preset, find_scenario

#: The training preset of a scenario that names none.
DEFAULT_PRESET = "fast"

Model = TypeVar("Model", bound=BaseModel)


def load_scenario(
    source: str | Path | Mapping[str, Any] | Scenario,
    overrides: Iterable[str] | Mapping[str, Any] = (),
) -> Scenario:
    """Load and check a scenario.

    Args:
        source: a bundled name (`paper/k10-fdd`), a path to a YAML file, a mapping with
            the keys of a file, or a `Scenario`.
        overrides: `["auvs.count=3", …]` or `{"auvs.count": 3, …}`, over the file.

    Returns:
        the scenario, with everything that it extends and its training preset filled in.

    Raises:
        InputError: one line with file, line, key and what was meant.
    """
    path = None
    if isinstance(source, Scenario):
        layer = Layer(source.model_dump(exclude_unset=False), {(): source.name})
    elif isinstance(source, Mapping):
        layer = _mapping_layer(source)
    else:
        path = find_scenario(source)
        layer = read_with_bases(path)
        layer.data.setdefault("name", _name_of(path))
    layer = overrides_layer(overrides).over(layer)
    return validate(Scenario, _with_preset(layer, path))


def parse_scenario(path: Path, contents: bytes) -> Scenario:
    """The scenario in a file that extends no other, that of a run say, whose contents are known.

    Raises:
        InputError: as by `load_scenario`.
    """
    return validate(Scenario, _with_preset(parse_file(path, contents), path))


def _mapping_layer(source: Mapping[str, Any]) -> Layer:
    data = dict(source)
    merged = Layer()
    for base in pop_bases(data, "scenario"):
        merged = read_with_bases(base).over(merged)
    return Layer(data, {(): "scenario"}).over(merged)


def _name_of(path: Path) -> str:
    path = path.resolve()
    root = bundled_root().resolve()
    if path.is_relative_to(root):
        return path.relative_to(root).with_suffix("").as_posix()
    return path.stem


def _with_preset(layer: Layer, scenario_path: Path | None) -> Layer:
    """The training settings of the preset under those of the scenario.

    A scenario that is resolved, that of a run say, no longer needs its preset's file.

    A preset is a mapping of training settings. Its `cases` are a list of
    `{when: {dotted key: value, …}, set: {…}}`: each whose conditions all hold in the
    scenario is laid over what stands above it.
    """
    training = layer.data.get("training", {})
    if not isinstance(training, dict):
        return layer
    if set(Training.model_fields) <= set(training):
        return layer
    name = training.get("preset", DEFAULT_PRESET)
    path: KeyPath = ("training", "preset")
    if not isinstance(name, str):
        raise InputError(f"{layer.origin(path)}: training.preset: must be a word")
    try:
        preset = read_file(find_preset(name, scenario_path))
    except InputError as error:
        raise InputError(f"{layer.origin(path)}: training.preset: {error}") from None
    cases = preset.data.pop("cases", [])
    if not isinstance(cases, list):
        raise InputError(f"{preset.origin(('cases',))}: cases: must be a list")
    merged = _below("training", preset)
    for i, case in enumerate(cases):
        where = preset.origin(("cases", i))
        if not (
            isinstance(case, dict)
            and set(case) == {"when", "set"}
            and all(isinstance(part, dict) for part in case.values())
        ):
            raise InputError(f"{where}: cases: each must have the mappings 'when' and 'set'")
        if all(_value_at(layer.data, key) == value for key, value in case["when"].items()):
            chosen = Layer(case["set"], {(): where, **{(key,): where for key in case["set"]}})
            merged = _below("training", chosen).over(merged)
    merged.data["training"]["preset"] = name
    return layer.over(merged)


def _below(key: str, layer: Layer) -> Layer:
    return Layer({key: layer.data}, {(key, *path): o for path, o in layer.origins.items()})


def _value_at(data: Any, dotted: str) -> Any:
    for key in dotted.split("."):
        data = data.get(key) if isinstance(data, dict) else None
    return data


def validate(model: type[Model], layer: Layer) -> Model:
    """A layer's settings as a checked model.

    Raises:
        InputError: one line with file, line, key and what was meant.
    """
    try:
        return model.model_validate(layer.data)
    except ValidationError as error:
        problems = error.errors(include_url=False)
        more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
        raise InputError(_describe(problems[0], layer) + more) from None


def _describe(problem: ErrorDetails, layer: Layer) -> str:
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
        path = (*path, "kind")
        message = f"unknown kind {context['tag']!r}{did_you_mean(str(context['tag']), tags)}"
    elif kind == "literal_error":
        choices = [c.strip(" '") for c in context["expected"].replace(" or ", ",").split(",")]
        message = f"unknown value {given!r}{did_you_mean(str(given), choices)}"
    elif kind == "finite_number":
        message = f"must be a finite number, not {given}"
    elif kind == "tuple_type":
        message = f"must be a list, not {_short(given)}"
    elif kind == "too_short":
        message = f"must list at least {context['min_length']}, not {context['actual_length']}"
    elif kind == "too_long":
        message = f"must list at most {context['max_length']}, not {context['actual_length']}"
    elif kind in ("model_type", "model_attributes_type", "dict_type"):
        message = f"must be a mapping of keys to values, not {_short(given)}"
    elif kind != "invalid":
        message = f"{message.replace('Input should', 'must')}, not {_short(given)}"
    return f"{layer.origin(path)}: {show_path(path)}: {message}"


def _short(value: Any) -> str:
    try:
        text = repr(value)
    except ValueError:
        text = "a number of too many digits"
    return text if len(text) <= 40 else f"{text[:37]}..."


def _without_tags(location: tuple[str | int, ...], data: Any) -> KeyPath:
    """pydantic's location of an error without the kinds that it puts behind a part's key."""
    path: list[str | int] = []
    for key in location:
        if isinstance(data, dict) and key not in data and data.get("kind") == key:
            continue
        path.append(key)
        if isinstance(data, dict):
            data = data.get(str(key))
        elif isinstance(data, list) and isinstance(key, int) and key < len(data):
            data = data[key]
        else:
            data = None
    return tuple(path)


def to_yaml(scenario: Scenario) -> str:
    """The whole scenario as YAML that `load_scenario` reads back."""
    yaml = YAML(typ="rt", pure=True)
    yaml.width = 100
    yaml.representer.add_representer(
        type(None), lambda r, _: r.represent_scalar("tag:yaml.org,2002:null", "null")
    )
    stream = io.StringIO()
    yaml.dump(_styled(scenario.model_dump(mode="json")), stream)
    return stream.getvalue()


def _styled(data: Any) -> Any:
    """The same data, marked: lists of scalars stand in one line, odd characters are escaped."""
    if isinstance(data, dict):
        return {key: _styled(value) for key, value in data.items()}
    if isinstance(data, list):
        items = CommentedSeq(_styled(value) for value in data)
        if not any(isinstance(value, list | dict) for value in data):
            items.fa.set_flow_style()
        return items
    if isinstance(data, str) and not data.isprintable():
        return DoubleQuotedScalarString(data)
    return data
