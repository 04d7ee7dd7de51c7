"""From a name, a file or a mapping to a checked `Scenario`."""

from __future__ import annotations

import functools
import io
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedSeq
from ruamel.yaml.scalarstring import DoubleQuotedScalarString

from iout_marl.errors import InputError
from iout_marl.scenario.bases import mapping_layer, read_with_bases, with_over_read
from iout_marl.scenario.data_files import PATH_OF, PathOf
from iout_marl.scenario.drawing import check_families
from iout_marl.scenario.layers import Layer, Overrides, overrides_layer, parse_file
from iout_marl.scenario.naming import find_scenario, name_of, split_member
from iout_marl.scenario.places import Places
from iout_marl.scenario.presets import names_preset, with_preset
from iout_marl.scenario.problems import validate
from iout_marl.scenario.schema import Scenario
from iout_marl.scenario.training import Training
from iout_marl.whole import short

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
        source: a bundled name (`paper/k10-fdd`), a path to a YAML file, or to one with a member
            of the family in it (`mine.yaml/k10-fdd`), a mapping with the keys of a file, or a
            `Scenario`, which without overrides comes back as it is.
        overrides: `"auvs.count=3"`, several of them, or `{"auvs.count": 3, …}`, over the
            file. Numbers and arrays of NumPy are taken for plain ones.
        beside: the file in which the overrides were written: a training preset that they
            name is looked for in its folder, not in that of the scenario.

    Returns:
        the scenario, with everything that it extends and its training preset filled in.

    Raises:
        InputError: one line with file, line, key and what was meant.
    """
    above = overrides_layer(overrides)
    if isinstance(source, Scenario) and not above.data:
        return source
    return _checked(_whole(source, above, beside))


def where_written(source: AnyScenario, overrides: Overrides, key: str) -> str:
    """Where a dotted key of a scenario was written: file and line, or the override.

    Args:
        source, overrides: as `load_scenario` has taken them.
        key: the key.

    Raises:
        InputError: the scenario cannot be read any more.
    """
    return _whole(source, overrides_layer(overrides), None).origin(tuple(key.split(".")))


def _whole(source: AnyScenario, above: Layer, beside: Path | None) -> Layer:
    """The overrides over a scenario over all that it extends and its preset."""
    layer, path = scenario_layer(source)
    if names_preset(above):
        path = beside or path
    return with_preset(above.over(layer), path)


def scenario_layer(source: AnyScenario) -> tuple[Layer, Path | None]:
    """What a scenario says itself, without its training preset; and the path of its file.

    Raises:
        InputError: as by `load_scenario`.
    """
    if isinstance(source, Scenario):
        return Layer(source.model_dump(), Places(source.name)), None
    if isinstance(source, Mapping):
        return mapping_layer(source), None
    if isinstance(source, str | bytes | os.PathLike):
        found = find_scenario(os.fsdecode(source))
        layer = read_with_bases(found)
        layer.data.setdefault("name", name_of(found))
        return layer, split_member(found)[0]
    raise InputError(
        f"scenario: must be a name, a path, a mapping or a Scenario, not {short(source)}"
    )


def parse_scenario(path: Path, contents: bytes) -> Scenario:
    """The scenario in a file that extends no other, that of a run say, whose contents are known.

    Raises:
        InputError: as by `load_scenario`.
    """
    return _checked(with_preset(parse_file(path, contents), path))


def _checked(layer: Layer) -> Scenario:
    read = with_over_read(layer)
    scenario = validate(
        Scenario,
        read,
        if_missing="; to begin with a bundled scenario, write extends: paper/k10-fdd, say",
    )
    if scenario.training.over:
        check_families(scenario, read)
    return scenario


def to_yaml(scenario: Scenario, path_of: PathOf | None = None) -> str:
    """The whole scenario as YAML that `load_scenario` reads back.

    Args:
        scenario: the scenario.
        path_of: how the path of a file of data is written; by default as where it was found.
    """
    context = {} if path_of is None else {PATH_OF: path_of}
    data = scenario.model_dump(mode="json", context=context)
    # What came later is shown only where it says something.
    if not scenario.allow_implausible:
        del data["allow_implausible"]
    if scenario.grid.origin is None:
        del data["grid"]["origin"]
    if not scenario.observation.entries:
        del data["observation"]["entries"]
    for key, default in Training.written_if_set.items():
        if data["training"][key] == default:
            del data["training"][key]
    return dump_yaml(data)


def dump_yaml(data: Mapping[str, Any]) -> str:
    """Plain values as YAML that is pleasant to read."""
    return _written(json.dumps(data))


@functools.lru_cache(maxsize=16)
def _written(data: str) -> str:
    """The same of values in JSON; it takes milliseconds, and trainings and recordings ask again."""
    yaml = YAML(typ="rt", pure=True)
    yaml.width = 100
    yaml.representer.add_representer(
        type(None), lambda r, _: r.represent_scalar("tag:yaml.org,2002:null", "null")
    )
    stream = io.StringIO()
    yaml.dump(_styled(json.loads(data)), stream)
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
