"""Policies as the command line names them: untrained ones by name, trained ones by folder."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from iout_marl.errors import InputError, did_you_mean
from iout_marl.evaluation import Evaluation, evaluate
from iout_marl.policies import UNTRAINED, USUAL, Budget, PlannerPolicy, Policy, make_baseline
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
    scenario: Scenario,
    policy: str,
    episodes: int,
    seed: int,
    *,
    transfer: bool,
    planner: PlannerPolicy | None = None,
) -> Evaluation:
    """Run the policy of that name, or of the run in that folder, over seeded episodes.

    Args:
        scenario, episodes, seed: as for `evaluate`.
        policy: a name, or a folder.
        transfer: as for `trainers.train.load_run`.
        planner: what to play where the policy is `planner`; None for the usual one.

    Raises:
        InputError: it is neither, or the run does not fit the scenario.
    """
    own, player = _named(scenario, policy, seed, transfer=transfer, option="--policy")
    if planner is not None and policy == "planner":
        player = planner
    return evaluate(own, player, episodes, seed)


def planner_budget(seconds: float | None, rounds: int | None) -> Budget:
    """The budget that `--planner-seconds` and `--planner-rounds` ask for."""
    return USUAL if seconds is None and rounds is None else Budget(rounds, seconds)


def started_planner(
    scenario: Scenario, starts: list[str], budget: Budget, seed: int, *, transfer: bool
) -> PlannerPolicy:
    """A planner that starts from policies, by their names or folders.

    Raises:
        InputError: one is neither, or does not fit the scenario.
    """
    option = "--planner-start"
    named = [_named(scenario, name, seed, transfer=transfer, option=option) for name in starts]
    return PlannerPolicy(budget, warm=[policy for _, policy in named])


def _named(
    scenario: Scenario, policy: str, seed: int, *, transfer: bool, option: str
) -> tuple[Scenario, Policy]:
    """The policy that an option names, and the scenario that it plays."""
    if policy in UNTRAINED:
        return pin_layout(scenario, seed), make_baseline(policy)
    if not _is_folder(policy):
        raise InputError(
            f"{option} {policy}: neither a baseline nor the folder of a run"
            + did_you_mean(policy, UNTRAINED)
        )
    run, own = _load_run(scenario, policy, transfer=transfer)
    return own, run.load_policy()


def _is_folder(name: str) -> bool:
    return os.path.isdir(name)  # noqa: PTH112 (Path raises where a name is too long)


def _load_run(scenario: Scenario, name: str, *, transfer: bool) -> tuple[RunFolder, Scenario]:
    import torch

    from trainers.loading import load_run

    torch.set_num_threads(1)
    return load_run(Path(name), scenario, transfer=transfer)
