"""How what a trainer has learnt gets into its runs' folders."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torch import Tensor

from iout_marl.errors import InputError
from iout_marl.files import user_path
from iout_marl.scenario import to_yaml
from trainers.runs import saving
from trainers.runs.folder import RunFolder
from trainers.runs.loading import differences
from trainers.runs.preparing import make_new, new_runs, refuse_to_begin, take_over

if TYPE_CHECKING:
    from trainers.base import BaseTrainer


class NotFiniteError(Exception):
    """Weights are no longer finite; nothing was saved.

    Attributes:
        run: of the policy.
    """

    def __init__(self, run: RunFolder) -> None:
        self.run = run
        super().__init__(run.path)


def write_runs(trainer: BaseTrainer, runs: Sequence[RunFolder], group_folder: Path | None) -> None:
    """Save every policy, or none: all processes gather what the first one writes.

    Args:
        trainer: what to save.
        runs: the folder of each policy, which the caller has for itself.
        group_folder: the folder above those of several policies.

    Raises:
        NotFiniteError: the weights of one are not.
        InputError: a file cannot be written; the save before is as it was.
    """
    files = {}
    for i, run in enumerate(runs):
        state = trainer.state_dict(i)
        if not _is_finite([state["network"], state["optimizer"]]):
            raise NotFiniteError(run)
        if trainer.runtime.group.rank == 0:
            scenario = trainer.scenarios[i]
            run.copy_data(scenario)
            files[run.path] = {
                "scenario.yaml": to_yaml(scenario, lambda file: file.name_of_copy).encode(),
                **run.saved_files(trainer, state, i),
            }
    if files:
        saving.save(files, group_folder)


def _is_finite(state: Any) -> bool:
    if isinstance(state, Mapping):
        return _is_finite(list(state.values()))
    if isinstance(state, list):
        return all(map(_is_finite, state))
    return not isinstance(state, Tensor) or bool(state.isfinite().all())


def save_trainer(trainer: BaseTrainer, path: str | Path) -> None:
    """See `BaseTrainer.save`."""
    out, group = user_path(path, "path"), trainer.runtime.group
    runs = new_runs(out, trainer.seeds.start, len(trainer.seeds))
    group_folder = None if runs[0].path == out else out
    with ExitStack() as held:
        if saving.is_used(out):
            check = partial(_refuse_others, trainer, runs)
            take_over(out, runs, group, held, check)
            check()
        else:
            refuse_to_begin(out, runs, group)
            make_new(out, runs, trainer.scenarios, group, held)
        try:
            write_runs(trainer, runs, group_folder)
        except NotFiniteError as error:
            raise InputError(f"{error.run.path}: the weights are not finite; not saved") from None


def _refuse_others(trainer: BaseTrainer, runs: Sequence[RunFolder]) -> None:
    """Leave runs alone that are not this training's."""
    for run, scenario, seed in zip(runs, trainer.scenarios, trainer.seeds, strict=True):
        saved = run.load_checkpoint()
        if saved.get("seed") != seed or differences(run.scenario(), scenario):
            raise InputError(f"{run.path}: holds another run; save to another folder")
