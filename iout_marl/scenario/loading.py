"""From a name, a file or a mapping to a checked `Scenario`."""

from __future__ import annotations

import io
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from pydantic import BaseModel, ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedSeq
from ruamel.yaml.scalarstring import DoubleQuotedScalarString

from iout_marl.errors import InputError
from iout_marl.outside import load_entry_points
from iout_marl.scenario.keys import unknown_keys
from iout_marl.scenario.layers import (
    Layer,
    Overrides,
    mapping_layer,
    overrides_layer,
    parse_file,
    read_with_bases,
)
from iout_marl.scenario.places import Places, show_value
from iout_marl.scenario.presets import names_preset, with_preset
from iout_marl.scenario.problems import describe, describe_unknown
from iout_marl.scenario.schema import Scenario
from iout_marl.scenario.sources import bundled_root, find_scenario

Model = TypeVar("Model", bound=BaseModel)
#: Whatever is taken for a scenario: a bundled name, a path, a mapping, or a `Scenario`.
AnyScenario: TypeAlias = str | os.PathLike[str] | Mapping[str, Any] | Scenario


def load_scenario(
    source: AnyScenario,
    overrides: Overrides = (),
    *,
    beside: Path | None = None,
) -> Scenario:
    """Load and check a scenario.

    What a file lists (`nodes.cells`, `auvs.start_cells`) and a scenario that it extends counts
    (`nodes.count`, `auvs.count`) is meant as listed: that count no longer holds. Overrides and
    what they are laid over are two layers of this kind as well.

    Args:
        source: a bundled name (`paper/k10-fdd`), a path to a YAML file, a mapping with
            the keys of a file, or a `Scenario`, which without overrides comes back as it is.
        overrides: `"auvs.count=3"`, several of them, or `{"auvs.count": 3, …}`, over the
            file. Numbers and arrays of NumPy are taken for plain ones.
        beside: the file in which the overrides were written: a training preset that they
            name is looked for in its folder, not in that of the scenario.

    Returns:
        the scenario, with everything that it extends and its training preset filled in.

    Raises:
        InputError: one line with file, line, key and what was meant.
    """
    path, above = None, overrides_layer(overrides)
    if isinstance(source, Scenario):
        if not above.data:
            return source
        layer = Layer(source.model_dump(), Places(source.name))
    elif isinstance(source, Mapping):
        layer = mapping_layer(source)
    elif isinstance(source, str | bytes | os.PathLike):
        path = find_scenario(os.fsdecode(source))
        layer = read_with_bases(path)
        layer.data.setdefault("name", _name_of(path))
    else:
        raise InputError(
            f"scenario: must be a name, a path, a mapping or a Scenario, not {show_value(source)}"
        )
    if names_preset(above):
        path = beside or path
    return validate(Scenario, with_preset(above.over(layer), path))


def parse_scenario(path: Path, contents: bytes) -> Scenario:
    """The scenario in a file that extends no other, that of a run say, whose contents are known.

    Raises:
        InputError: as by `load_scenario`.
    """
    return validate(Scenario, with_preset(parse_file(path, contents), path))


def _name_of(path: Path) -> str:
    path = path.resolve()
    root = bundled_root().resolve()
    if path.is_relative_to(root):
        return path.relative_to(root).with_suffix("").as_posix()
    return path.stem


def validate(model: type[Model], layer: Layer) -> Model:
    """A layer's settings as a checked model.

    Raises:
        InputError: one line with file, line, key and what was meant.
    """
    load_entry_points()
    unknown = describe_unknown(model, unknown_keys((model,), layer.data), layer)
    if unknown:
        raise InputError(unknown)
    try:
        return model.model_validate(layer.data)
    except ValidationError as error:
        problems = error.errors(include_url=False)
        more = f" (and {len(problems) - 1:,} more)" if len(problems) > 1 else ""
        raise InputError(describe(problems[0], layer) + more) from None


def to_yaml(scenario: Scenario) -> str:
    """The whole scenario as YAML that `load_scenario` reads back."""
    yaml = YAML(typ="rt", pure=True)
    yaml.width = 100
    yaml.representer.add_representer(
        type(None), lambda r, _: r.represent_scalar("tag:yaml.org,2002:null", "null")
    )
    stream = io.StringIO()
    data = scenario.model_dump(mode="json")
    # What came later is shown only where it says something.
    if not scenario.allow_implausible:
        del data["allow_implausible"]
    if not scenario.observation.entries:
        del data["observation"]["entries"]
    yaml.dump(_styled(data), stream)
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
