"""Trainings that begin with weights of another one: fine-tuning."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from torch import Tensor

from iout_marl.errors import InputError
from iout_marl.policies.loading import is_run
from iout_marl.policies.named import PRETRAINED
from iout_marl.scenario import AnyScenario, Overrides, Scenario, load_scenario
from trainers.pretrained import load_modes, mode_for
from trainers.runs.folder import RunFolder

#: Settings of a training that has little to learn.
PRESET = "fine-tune"


def started_from(
    start: str, scenario: AnyScenario, overrides: Overrides = None
) -> tuple[Scenario, Mapping[str, Tensor]]:
    """A scenario as networks for node tables see it, and the weights that they begin with.

    Args:
        start: `pretrained`, or the folder of a run with `training.network: set`.
        scenario: what to train on; its training takes what it does not say itself from the preset
            `fine-tune`, and the networks from the start.
        overrides: changes of the scenario, as for `load_scenario`.

    Raises:
        InputError: there is no such start, or it does not fit the scenario's actions.
    """
    asked = load_scenario(scenario, overrides)
    if start == PRETRAINED:
        mode = mode_for(load_modes(), asked, f"--from {start}")
        source, weights = mode.scenario, mode.weights
    elif is_run(start):
        folder = RunFolder(start)
        source, weights = folder.scenario(), folder.load_policy().network.state_dict()
        if not source.training.network.part.is_for_any_size:
            raise InputError(
                f"--from {start}: its networks are for one size: only those of training.network: "
                "set can go on elsewhere"
            )
        if source.duplex.part.num_choices != asked.duplex.part.num_choices:
            raise InputError(
                f"--from {start}: was trained for duplex.kind {source.duplex.kind}, not "
                f"{asked.duplex.kind}"
            )
    else:
        raise InputError(f"--from {start}: is neither {PRETRAINED} nor the folder of a run")
    observation = {
        **source.observation.model_dump(),
        "view_range_m": asked.observation.view_range_m,
    }
    changes: dict[str, Any] = {
        "observation": observation,
        "training.preset": PRESET,
        "training.critic": "own",
        "training.mask_actions": source.training.mask_actions,
        "training.network": source.training.network.model_dump(),
    }
    return load_scenario(load_scenario(scenario, changes), overrides), weights
