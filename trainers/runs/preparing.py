"""The folders of a training: checked before anything is written, then this process's alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from iout_marl.errors import InputError
from iout_marl.files import LOCK_NAME, reason
from iout_marl.scenario import Scenario
from trainers.accel.group import LostProcessError, ProcessGroup
from trainers.runs import beginning, saving
from trainers.runs.folder import RunFolder
from trainers.runs.occupied import occupied


def new_runs(out: Path, seed: int, replicas: int) -> list[RunFolder]:
    """The folder of a lone run, or one within it for each of several policies."""
    if replicas == 1:
        return [RunFolder(out)]
    return [RunFolder(out / f"seed-{seed + i}") for i in range(replicas)]


def refuse_to_begin(out: Path, runs: Sequence[RunFolder], group: ProcessGroup) -> None:
    """Leave alone what is in the folders of new runs, before anything is made.

    Raises:
        InputError: there is a run, or a file that a run would write over.
    """
    with _all_or_none(group):
        if group.rank == 0:
            _refuse(out, runs)


def make_new(
    out: Path,
    runs: Sequence[RunFolder],
    scenarios: Sequence[Scenario],
    group: ProcessGroup,
    held: ExitStack,
) -> None:
    """Make the folders of new runs, and keep others out of them as long as `held` does.

    They hold copies of their scenarios' files of data from then on.

    Raises:
        InputError: as `refuse_to_begin`; another process trains there; or they cannot be made.
    """
    with _all_or_none(group):
        if group.rank > 0:
            return
        try:
            out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{out}: cannot be made: {reason(error)}") from None
        held.enter_context(occupied(out, [run.path for run in runs]))
        _refuse(out, runs)  # again: until now another process may have begun
        if runs[0].path != out:
            beginning.begin(out / saving.GROUP)
        for run, scenario in zip(runs, scenarios, strict=True):
            run.create()
            run.copy_data(scenario)


def take_over(
    out: Path,
    runs: Sequence[RunFolder],
    group: ProcessGroup,
    held: ExitStack,
    check: Callable[[], object],
) -> None:
    """Keep others out of the folders of runs to resume, as long as `held` does.

    Args:
        out, runs, group, held: as for `make_new`.
        check: refuses what cannot be resumed. It is asked before a first lock is made in a
            folder; whoever resumes asks it again.

    Raises:
        InputError: as `check`; or another process trains there.
    """
    with _all_or_none(group):
        if group.rank > 0:
            return
        if not (out / LOCK_NAME).exists():
            check()
        if out.is_dir():  # if not, there is nothing to resume
            held.enter_context(occupied(out, [run.path for run in runs]))


def _refuse(out: Path, runs: Sequence[RunFolder]) -> None:
    for run in (RunFolder(out), *map(RunFolder, saving.members(out)), *runs):
        run.refuse_if_used()
    for run in runs:
        run.refuse_what_is_no_runs()
    if runs[0].path != out:
        beginning.refuse_what_is_no_runs(out / saving.GROUP)


@contextmanager
def _all_or_none(group: ProcessGroup) -> Iterator[None]:
    """What the first process begins with: if it fails, so do the others, with less to say."""
    failure = None
    try:
        yield
    except InputError as error:
        failure = error
    try:
        is_refused = group.any(failure is not None)
    except LostProcessError:
        is_refused = True
    if is_refused:
        raise failure or InputError("the first process could not begin")
