"""How a training continues from what it has saved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch

from iout_marl.errors import InputError
from iout_marl.scenario import Scenario
from iout_marl.world import pin_layout
from trainers.accel.group import ProcessGroup
from trainers.ppo import Trainer
from trainers.runs import saving
from trainers.runs.checking import check_origin, check_state
from trainers.runs.folder import RunFolder, readable
from trainers.runs.loading import differences

#: Settings that a resumed run may change.
CHANGEABLE = ("training.steps", "training.checkpoint_steps")


def runs_in(out: Path) -> list[RunFolder]:
    """The run in a folder, or those of several policies within it.

    Raises:
        InputError: the folder cannot be read, or what says which policies are in it is damaged.
    """
    together = saving.members_of_group(out)
    # Before the manifest nothing but the folders told of several policies.
    several = together or ([] if saving.is_used(out) else saving.members(out))
    return [RunFolder(path) for path in several or [out]]


def refuse_to_resume(
    runs: Sequence[RunFolder], scenario: Scenario, *, is_together: bool
) -> list[dict[str, Any]]:
    """What the runs have saved, if a training of this scenario can continue from there.

    Args:
        runs, scenario, is_together: as for `resumed`.

    Raises:
        InputError: as for `resumed`, as far as it can be told without a trainer.
    """
    scenarios = [run.scenario() for run in runs]
    saved = [run.load_checkpoint() for run in runs]
    for run, one in zip(runs, saved, strict=True):
        check_origin(run.checkpoint_path, one)
    if is_together:
        _check_together(runs[0].path.parent, saved)
    for run, own, one in zip(runs, scenarios, saved, strict=True):
        wanted = pin_layout(scenario, one["seed"])
        strange = [k for k in differences(own, wanted) if k not in CHANGEABLE]
        if strange:
            raise InputError(
                f"{run.path}: is a run of another scenario, {own.name}: {strange[0]} differs"
            )
    # A training ends with the rollout in which it reaches its steps.
    settings, taken = scenario.training, saved[0]["env_steps"]
    # Rollouts of training.over and of teachers may be longer.
    if (
        not settings.over
        and settings.imitate is None
        and taken >= settings.steps + settings.environments * settings.rollout_slots
    ):
        raise InputError(
            f"{runs[0].path}: has taken {taken:,} steps already, more than the "
            f"{settings.steps:,} of training.steps; to continue, ask for more"
        )
    return saved


def _check_together(out: Path, saved: Sequence[Mapping[str, Any]]) -> None:
    """Refuse policies that cannot continue side by side."""
    seeds = [one["seed"] for one in saved]
    steps = [one["env_steps"] for one in saved]
    trained = {tuple(one["side_by_side"]) for one in saved}
    if min(steps) < max(steps):
        fault = f"have not come equally far, but {min(steps):,} to {max(steps):,} steps"
    elif trained == {(seeds[0], len(seeds))} and seeds == [*range(seeds[0], seeds[-1] + 1)]:
        return
    elif any(count == 1 for _, count in trained):
        fault = "have been trained alone since they were trained side by side"
    else:
        fault = "are not all that were trained side by side: some are missing"
    raise InputError(f"{out}: these runs {fault}; continue with each by its own folder")


def resumed(
    runs: Sequence[RunFolder],
    scenario: Scenario,
    device: torch.device,
    group: ProcessGroup,
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
        InputError: there is nothing to continue from, or not from there.
    """
    saved = refuse_to_resume(runs, scenario, is_together=is_together)
    seed = saved[0]["seed"]
    trainer = Trainer(scenario, seed, device, len(runs), group, use_graphs=use_graphs)
    for policy, (run, one) in enumerate(zip(runs, saved, strict=True)):
        check_state(run.checkpoint_path, one, trainer, policy)
    with readable(runs[0].checkpoint_path):
        trainer.load_state_dict(*saved)
    return trainer


def is_complete(runs: Sequence[RunFolder], trainer: Trainer) -> bool:
    """Whether resumed runs have all steps that are asked for, and all of their files."""
    return trainer.finished and not any(map(RunFolder.missing, runs))
