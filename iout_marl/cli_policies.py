"""Policies as the command line names them: untrained ones by name, trained ones by folder."""

from __future__ import annotations

import difflib
import os
import re
import shlex
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from iout_marl.errors import InputError, did_you_mean
from iout_marl.evaluation import Evaluation, evaluate
from iout_marl.files import refuse_input
from iout_marl.policies import UNTRAINED, USUAL, Budget, PlannerPolicy, Policy, make_baseline
from iout_marl.scenario import Scenario
from iout_marl.words import listed
from iout_marl.world import pin_layout

#: Runs that a message names at most.
_NAMED_RUNS = 8

if TYPE_CHECKING:
    from trainers import RunFolder


def keep_inputs(target: Path | None, policies: list[str]) -> None:
    """Refuse to write over what the command reads, before it takes its time.

    Args:
        target: where it writes its results, if at all.
        policies: names of policies, or the folders of runs.

    Raises:
        InputError: the target has been read, or is one of the files of such a run.
    """
    if target is None:
        return
    refuse_input(target)
    place = target.resolve()
    for folder in policies:
        if (
            folder not in UNTRAINED
            and _is_folder(folder)
            and place.parent == Path(folder).resolve()
        ):
            from trainers.run_folder import is_of_a_run

            if is_of_a_run(place.name):
                raise InputError(f"{target}: cannot be written: it is a file of the run {folder}")


def with_layout_of_runs(scenario: Scenario, names: list[str], *, transfer: bool) -> Scenario:
    """The scenario; where a layout is drawn once for a run, with that of the first run named."""
    for name in names:
        if name not in UNTRAINED and _is_folder(name) and not _members(Path(name)):
            return _load_run(scenario, name, transfer=transfer)[1]
    return scenario


def evaluate_named(
    scenario: Scenario, policy: str, episodes: int, seed: int, *, transfer: bool
) -> Evaluation:
    """Run the policy of that name, or of the run in that folder, over seeded episodes.

    Args:
        scenario, episodes, seed: as for `evaluate`.
        policy: a name, or a folder.
        transfer: as for `trainers.loading.load_run`.

    Raises:
        InputError: it is neither, or the run does not fit the scenario.
    """
    own, player = _named(scenario, policy, seed, "--policy", transfer=transfer)
    return evaluate(own, player, episodes, seed)


def evaluate_all(
    scenario: Scenario,
    names: list[str],
    starts: list[str],
    budget: Budget | None,
    episodes: int,
    seed: int,
    *,
    transfer: bool,
    sampled: bool,
) -> tuple[list[Evaluation], str]:
    """Run policies by their names or folders.

    Where a layout is drawn once for a run, every run plays in its own, all else in that of the
    first run; by transfer, that is where all of them play.

    Args:
        scenario, episodes, seed, transfer: as for `evaluate_named`.
        names: the policies.
        starts: policies that the planner starts from.
        budget: what the planner spends; None for the usual.
        sampled: draw trained policies' actions rather than take the most probable.

    Returns:
        the evaluations, and who plays in which layout.

    Raises:
        InputError: one is neither, or does not fit the scenario.
    """
    runs = [name for name in names if name not in UNTRAINED]
    if sampled and not runs:
        raise InputError("--sampled: none of the policies is a trained one, by the folder of a run")
    layout = with_layout_of_runs(scenario, [*names, *starts], transfer=transfer)
    planner = None
    if starts or budget is not None:
        if "planner" not in names:
            raise InputError("--planner-…: there is no planner without --policy planner")
        planner = started_planner(layout, starts, budget or USUAL, seed, transfer=transfer)
    # All are looked up before the first is played, which may take its time.
    players = [
        _named(
            scenario if name in runs and not transfer else layout,
            *(name, seed, "--policy"),
            transfer=transfer,
            sampled=sampled,
        )
        for name in names
    ]
    results = [
        evaluate(own, planner if name == "planner" and planner else player, episodes, seed)
        for name, (own, player) in zip(names, players, strict=True)
    ]
    others = [name for name in names if name in UNTRAINED]
    first = next((name for name in [*names, *starts] if name not in UNTRAINED), "")
    where = f", {listed(others)} in that of {first}" if others else ""
    return results, f"each run in its own layout{where}"


def planner_budget(seconds: float | None, rounds: int | None) -> Budget | None:
    """The budget that `--planner-seconds` and `--planner-rounds` ask for, if they do."""
    return None if seconds is None and rounds is None else Budget(rounds, seconds)


def started_planner(
    scenario: Scenario, starts: list[str], budget: Budget, seed: int, *, transfer: bool
) -> PlannerPolicy:
    """A planner that starts from policies, by their names or folders.

    Raises:
        InputError: one is neither, or does not fit the scenario.
    """
    named = [_named(scenario, name, seed, "--planner-start", transfer=transfer) for name in starts]
    return PlannerPolicy(budget, warm=[policy for _, policy in named])


def _named(
    scenario: Scenario,
    policy: str,
    seed: int,
    option: str,
    *,
    transfer: bool,
    sampled: bool = False,
) -> tuple[Scenario, Policy]:
    """The policy that an option names, and the scenario that it plays."""
    if policy in UNTRAINED:
        return pin_layout(scenario, seed), make_baseline(policy)
    if not _is_folder(policy):
        raise InputError(f"{option} {policy or shlex.quote(policy)}: {_what_else(policy)}")
    members = _members(Path(policy))
    if members:
        raise InputError(
            f"{option} {policy}: holds no trained policy, but folders that do: "
            + " ".join(f"{option} {shlex.quote(str(path))}" for path in members[:_NAMED_RUNS])
            + (f" and {len(members) - _NAMED_RUNS} more" if len(members) > _NAMED_RUNS else "")
        )
    run, own = _load_run(scenario, policy, transfer=transfer)
    trained = run.load_policy()
    trained.sampled = sampled
    return own, trained


def _what_else(name: str) -> str:
    """What the name of no policy is, or was meant to be."""
    if os.path.isfile(name):  # noqa: PTH113 (never raises)
        return "is a file, not the folder of a run"
    for place in (Path(name), Path("runs", name)):
        # A name that is too long, or a folder that is not there, holds nothing that is near.
        with suppress(OSError):
            runs = [path.name for path in place.parent.iterdir() if _holds_policy(path)]
            for near in difflib.get_close_matches(place.name, runs, 1, cutoff=0.75):
                meant = shlex.quote(str(place.parent / near))
                return f"neither a baseline nor the folder of a run; did you mean {meant}?"
    return f"neither a baseline nor the folder of a run{did_you_mean(name, UNTRAINED)}"


def _members(folder: Path) -> list[Path]:
    """Of a folder that is no run, the runs in it: those of several policies, say."""
    try:
        if _holds_policy(folder):
            return []
        found = [path.parent for path in folder.glob("*/policy.json")]
    except OSError as error:
        raise InputError(f"{folder}: cannot be read: {error.strerror}") from None
    # By their numbers, where they have any: seed-2 before seed-10.
    return sorted(found, key=lambda path: [int(n) for n in re.findall(r"\d{1,20}", path.name)])


def _holds_policy(folder: Path) -> bool:
    return (folder / "policy.json").is_file()


def _is_folder(name: str) -> bool:
    return os.path.isdir(name)  # noqa: PTH112 (Path raises where a name is too long)


def _load_run(scenario: Scenario, name: str, *, transfer: bool) -> tuple[RunFolder, Scenario]:
    import torch

    from trainers.loading import load_run

    torch.set_num_threads(1)
    return load_run(Path(name), scenario, transfer=transfer)
