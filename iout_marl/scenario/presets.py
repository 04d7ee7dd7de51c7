"""Training presets: files of training settings, with cases that depend on the scenario."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from iout_marl.errors import InputError, did_you_mean
from iout_marl.scenario.keys import all_keys, choices
from iout_marl.scenario.layers import Layer, read_file
from iout_marl.scenario.places import KeyPath, shorten
from iout_marl.scenario.problems import hint_to_key
from iout_marl.scenario.schema import Scenario
from iout_marl.scenario.sources import find_preset
from iout_marl.scenario.training import Training

#: The training preset of a scenario that names none.
DEFAULT_PRESET = "fast"


def names_preset(layer: Layer) -> bool:
    """Whether a layer says which preset the training settings come from."""
    return _at(layer.data, "training.preset") is not None


def with_preset(layer: Layer, scenario_path: Path | None) -> Layer:
    """The training settings of the preset under those of the scenario.

    A scenario that is resolved, that of a run say, no longer needs its preset's file.

    A preset is a mapping of training settings. Its `cases` are a list of
    `{when: {dotted key: value, …}, set: {…}}`: each whose conditions all hold in the
    scenario is laid over what stands above it.

    Args:
        layer: the scenario's settings.
        scenario_path: its file, beside which the preset may lie.

    Raises:
        InputError: the preset is not there, or is none.
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
    merged = preset.below("training")
    for i, case in enumerate(cases):
        where = preset.origin(("cases", i))
        if not (
            isinstance(case, dict)
            and set(case) == {"when", "set"}
            and all(isinstance(part, dict) for part in case.values())
        ):
            raise InputError(f"{where}: cases: each must have the mappings 'when' and 'set'")
        for key, value in case["when"].items():
            _check_condition(key, value, preset.origin(("cases", i, "when", key)))
        if all(_value_at(layer.data, key) == value for key, value in case["when"].items()):
            places = preset.places.inside["cases"].inside[i].inside["set"]
            merged = Layer(case["set"], places).below("training").over(merged)
    merged.data["training"]["preset"] = name
    return layer.over(merged)


def _check_condition(key: str, value: Any, where: str) -> None:
    """Refuse a condition that cannot hold in any scenario."""
    fields = all_keys(Scenario).get(key)
    if fields is None:
        hint = hint_to_key(Scenario, key)
        raise InputError(f"{where}: cases: when: {shorten(key)}: unknown key{hint}")
    listed = [choices(field) for field in fields]
    known = [str(choice) for values in listed for choice in values or ()]
    if None not in listed and value not in known:
        hint = did_you_mean(str(value), known)
        raise InputError(f"{where}: cases: when: {key}: unknown value {shorten(repr(value))}{hint}")


def _value_at(data: dict[str, Any], dotted: str) -> Any:
    """A scenario's setting; of a number of nodes or AUVs also that of cells listed."""
    found = _at(data, dotted)
    listed = {"nodes.count": "nodes.cells", "auvs.count": "auvs.start_cells"}.get(dotted)
    if found is None and listed is not None:
        cells = _at(data, listed)
        return len(cells) if isinstance(cells, list | tuple) else None
    return found


def _at(data: Any, dotted: str) -> Any:
    for key in dotted.split("."):
        data = data.get(key) if isinstance(data, dict) else None
    return data
