"""Policies as the command line names them: untrained ones by name, trained ones by folder."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from iout_marl.errors import InputError, did_you_mean
from iout_marl.evaluation import Evaluation, evaluate
from iout_marl.policies import UNTRAINED, make_baseline
from iout_marl.scenario import Scenario
from iout_marl.world import pin_layout

if TYPE_CHECKING:
    from trainers import RunFolder


def with_layout_of_runs(scenario: Scenario, names: list[str], *, transfer: bool) -> Scenario:
    """The scenario; where a layout is drawn once for a run, with that of the first run named."""
    for name in names:
        if name not in UNTRAINED and _is_folder(name):
            return _load_run(scenario, name, transfer=transfer)[1]
    return scenario


def evaluate_named(
    scenario: Scenario, policy: str, episodes: int, seed: int, *, transfer: bool
) -> Evaluation:
    """Run the policy of that name, or of the run in that folder, over seeded episodes.

    Raises:
        InputError: it is neither, or the run does not fit the scenario.
    """
    if policy in UNTRAINED:
        return evaluate(pin_layout(scenario, seed), make_baseline(policy), episodes, seed)
    if not _is_folder(policy):
        raise InputError(
            f"--policy {policy}: neither a baseline nor the folder of a run"
            + did_you_mean(policy, UNTRAINED)
        )
    run, own = _load_run(scenario, policy, transfer=transfer)
    return evaluate(own, run.load_policy(), episodes, seed)


def _is_folder(name: str) -> bool:
    return os.path.isdir(name)  # noqa: PTH112 (Path raises where a name is too long)


def _load_run(scenario: Scenario, name: str, *, transfer: bool) -> tuple[RunFolder, Scenario]:
    import torch

    from trainers.train import load_run

    torch.set_num_threads(1)
    return load_run(Path(name), scenario, transfer=transfer)
