"""Training presets: files of training settings, with cases that depend on the scenario."""

from __future__ import annotations

from pathlib import Path

from iout_marl.errors import InputError
from iout_marl.scenario.cases import cases_that_hold, value_at
from iout_marl.scenario.layers import Layer, read_file
from iout_marl.scenario.places import KeyPath
from iout_marl.scenario.sources import find_preset
from iout_marl.scenario.training import Training

#: The training preset of a scenario that names none.
DEFAULT_PRESET = "fast"


def names_preset(layer: Layer) -> bool:
    """Whether a layer says which preset the training settings come from."""
    return value_at(layer.data, "training.preset") is not None


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
    if set(Training.model_fields) - set(Training.written_if_set) <= set(training):
        return layer
    name = training.get("preset", DEFAULT_PRESET)
    path: KeyPath = ("training", "preset")
    if not isinstance(name, str):
        raise InputError(f"{layer.origin(path)}: training.preset: must be a word")
    try:
        preset = read_file(find_preset(name, scenario_path))
    except InputError as error:
        raise InputError(f"{layer.origin(path)}: training.preset: {error}") from None
    plain = {key: value for key, value in preset.data.items() if key != "cases"}
    merged = Layer(plain, preset.places).below("training")
    for settings, places in cases_that_hold(preset, layer.data):
        merged = Layer(settings, places).below("training").over(merged)
    merged.data["training"]["preset"] = name
    return layer.over(merged)
