"""How a training goes on from what it has saved."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch

from iout_marl.errors import InputError
from iout_marl.scenario import Scenario
from trainers import saving
from trainers.checking import check_origin, check_state
from trainers.group import Group
from trainers.loading import differences
from trainers.ppo import Trainer
from trainers.run_folder import RunFolder, readable

#: Settings that a resumed run may change.
CHANGEABLE = ("training.steps", "training.checkpoint_steps")


def runs_in(out: Path) -> list[RunFolder]:
    """The run in a folder, or those of several policies within it."""
    several = saving.members(out)
    is_lone = any((out / name).is_file() for name in (saving.MANIFEST, "scenario.yaml"))
    return [RunFolder(out)] if is_lone or not several else [RunFolder(path) for path in several]


def resumed(
    runs: Sequence[RunFolder],
    scenario: Scenario,
    device: torch.device,
    group: Group,
    *,
    is_together: bool,
    use_graphs: bool,
) -> Trainer:
    """A trainer in the state that the runs were saved in; nothing is written.

    Args:
        runs: of one policy, or of all that were trained side by side.
        scenario: what to train on; it may differ from theirs in `CHANGEABLE`.
        device: where to train.
        group: the processes that train together, each of which calls this.
        is_together: whether the runs are those of a group.
        use_graphs: as for `Trainer`.

    Raises:
        InputError: there is nothing to go on from, or not from there.
    """
    scenarios = [run.scenario() for run in runs]
    saved = [run.load_checkpoint() for run in runs]
    for run, one in zip(runs, saved, strict=True):
        check_origin(run.checkpoint_path, one)
    seeds = [one["seed"] for one in saved]
    first, count = saved[0]["side_by_side"]
    alike = len({(one["env_steps"], *one["side_by_side"]) for one in saved}) == 1
    if is_together and not (alike and seeds == list(range(first, first + count))):
        raise InputError(
            f"{runs[0].path.parent}: these runs have not come equally far, or some are missing; "
            "go on with each by its own folder"
        )
    trainer = Trainer(scenario, seeds[0], device, len(seeds), group, use_graphs=use_graphs)
    for run, own, wanted in zip(runs, scenarios, trainer.scenarios, strict=True):
        strange = [k for k in differences(own, wanted) if k not in CHANGEABLE]
        if strange:
            raise InputError(
                f"{run.path}: is a run of another scenario, {own.name}: {strange[0]} differs"
            )
    for policy, (run, one) in enumerate(zip(runs, saved, strict=True)):
        check_state(run.checkpoint_path, one, trainer, policy)
    with readable(runs[0].checkpoint_path):
        trainer.load_state_dict(*saved)
    # A training ends with the rollout in which it reaches its steps.
    if trainer.env_steps >= trainer.settings.steps + trainer.steps_per_iteration:
        raise InputError(
            f"{runs[0].path}: has taken {trainer.env_steps:,} steps already, more than the "
            f"{trainer.settings.steps:,} of training.steps; to go on, ask for more"
        )
    return trainer


def is_complete(runs: Sequence[RunFolder], trainer: Trainer) -> bool:
    """Whether resumed runs have all steps that are asked for, and their results."""
    return trainer.finished and all(run.result() is not None for run in runs)
