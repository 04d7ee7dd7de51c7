"""Trainings that begin with weights of another one: fine-tuning."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from torch import Tensor

from iout_marl.errors import InputError
from iout_marl.policies.loading import is_run
from iout_marl.policies.named import PRETRAINED
from iout_marl.scenario import AnyScenario, Overrides, Scenario, Training, load_scenario
from iout_marl.scenario.cases import value_at
from iout_marl.scenario.layers import Layer, overrides_layer
from iout_marl.scenario.loading import scenario_layer
from iout_marl.scenario.parts import Settings
from iout_marl.scenario.places import show_value
from trainers.pretrained import load_modes, mode_for
from trainers.runs.folder import RunFolder
from trainers.runs.loading import differences
from trainers.sizing import check_view

#: Settings of a training that has little to learn.
PRESET = "fine-tune"
_NETWORK = "training.network"
#: Settings that a training takes from its start where it does not say them itself.
_TAKEN = ("training.critic", "training.mask_actions")


def started_from(
    start: str,
    scenario: AnyScenario,
    overrides: Overrides = None,
    network: str | dict[str, Any] | None = None,
) -> tuple[Scenario, Mapping[str, Tensor]]:
    """A scenario as networks for node tables see it, and the weights that they begin with.

    Args:
        start: `pretrained`, or the folder of a run with `training.network: set`.
        scenario: what to train on; its training takes what it does not say itself from the preset
            `fine-tune`, and the networks from the start. Of a `Scenario`, which says everything,
            the network counts as not said where it is the default.
        overrides: changes of the scenario, as for `load_scenario`.
        network: in place of `training.network`.

    Raises:
        InputError: there is no such start, or it does not fit the scenario's actions, or the
            network or the observation that the scenario asks for.
    """
    who = f"--from {start}"
    said = overrides_layer(overrides)
    if network is not None:
        said = overrides_layer({_NETWORK: network}).over(said)
    own, _ = scenario_layer(scenario)
    if isinstance(scenario, Scenario):
        usual = scenario.training.network.kind == Training.hash_defaults["network"]
        own = _without(own, *_TAKEN, *([_NETWORK] if usual else ()))
    asked = load_scenario(scenario, _without(said, _NETWORK))
    source, weights = _source(start, asked, who)
    _refuse_other(who, source.training.network, value_at(said.over(own).data, _NETWORK))
    observation = source.observation.model_dump()
    check_view(who, observation, asked)
    changes: dict[str, Any] = {
        "observation": {**observation, "view_range_m": asked.observation.view_range_m},
        "training.preset": PRESET,
        _NETWORK: source.training.network.model_dump(),
    }
    if value_at(own.data, "training.critic") is None:
        changes["training.critic"] = "own"
    if value_at(own.data, "training.mask_actions") is None:
        changes["training.mask_actions"] = source.training.mask_actions
    started = load_scenario(scenario, changes)
    final = load_scenario(started, said)
    for key in differences(started, final):
        if key.startswith("observation."):
            raise InputError(f"{who}: its networks are for another {key}")
    return final, weights


def _source(start: str, asked: Scenario, who: str) -> tuple[Scenario, Mapping[str, Tensor]]:
    """What a start was trained on, and its weights."""
    if start == PRETRAINED:
        mode = mode_for(load_modes(), asked, who)
        return mode.scenario, mode.weights
    if not is_run(start):
        raise InputError(f"{who}: is neither {PRETRAINED} nor the folder of a run")
    folder = RunFolder(start)
    source, weights = folder.scenario(), folder.load_policy().network.state_dict()
    if not source.training.network.part.is_for_any_size:
        raise InputError(
            f"{who}: its networks are for one size: only those of training.network: "
            "set can go on elsewhere"
        )
    if source.duplex.part.num_choices != asked.duplex.part.num_choices:
        raise InputError(
            f"{who}: was trained for duplex.kind {source.duplex.kind}, not {asked.duplex.kind}"
        )
    return source, weights


def _refuse_other(who: str, network: Settings, said: Any) -> None:
    """Refuse a network that is said to be another than that of the weights."""
    if said is None:
        return
    asked = said if isinstance(said, dict) else {"kind": said}
    for key, value in network.model_dump().items():  # the kind comes first
        if asked.get(key, value) != value:
            name = _NETWORK if key == "kind" else f"{_NETWORK}.{key}"
            shown = [
                each if isinstance(each, str) else show_value(each) for each in (value, asked[key])
            ]
            raise InputError(f"{who}: its {name} is {shown[0]}, not {shown[1]}")


def _without(layer: Layer, *keys: str) -> Layer:
    """A layer less some of its dotted keys."""
    less = layer.over(Layer())
    for key in keys:
        section, _, name = key.rpartition(".")
        found = value_at(less.data, section)
        if isinstance(found, dict):
            found.pop(name, None)
    return less
