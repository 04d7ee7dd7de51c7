"""Policies as the command line names them, who plays where, and what the planner starts from."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from iout_marl.errors import InputError
from iout_marl.evaluation import Evaluation, evaluate
from iout_marl.files import refuse_input
from iout_marl.policies import DEFAULT_BUDGET, BestOf, Budget, GuidedBeam, PlannerPolicy, Policy
from iout_marl.policies.loading import is_run, is_trained, load_run, members, named_policy
from iout_marl.replay import Recording
from iout_marl.replay.recorder import FirstEpisode, record_player
from iout_marl.scenario import Scenario
from iout_marl.words import listed


class Ahead(NamedTuple):
    """How trained policies search before the first slot, if they do.

    Attributes:
        best_of: how many episodes are played ahead, to play the best of them.
        mirrored: as well in the mirror images of the world.
        beam: how many episodes a beam search keeps; None for no such search.
    """

    best_of: int = 1
    mirrored: bool = False
    beam: int | None = None

    @property
    def option(self) -> str | None:
        """The option that asks for it."""
        if self.beam:
            return "--beam"
        return "--best-of" if self.best_of > 1 else "--mirrored" if self.mirrored else None

    def check(self, names: list[str], *, sampled: bool) -> None:
        """Refuse what does not go together.

        Raises:
            InputError: none of the policies is trained, or actions are drawn, or searched for in
                two ways.
        """
        _need_trained(str(self.option), names)
        if sampled:
            raise InputError(f"{self.option}: decides itself what is drawn; leave out --sampled")
        other = self._replace(beam=None).option
        if self.beam and other:
            raise InputError(f"--beam: is a search of its own; leave out {other}")

    def searched(self, policy: Policy, seed: int) -> Policy:
        """The policy with its search."""
        if self.beam:
            return GuidedBeam(policy, self.beam)
        return BestOf(policy, self.best_of, mirrored=self.mirrored, seed=seed)


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
        if is_run(folder) and place.parent == Path(folder).resolve():
            from trainers.runs.folder import is_of_a_run

            if is_of_a_run(place.name):
                raise InputError(f"{target}: cannot be written: it is a file of the run {folder}")


def with_layout_of_runs(scenario: Scenario, names: list[str], *, transfer: bool) -> Scenario:
    """The scenario; where a layout is drawn once for a run, with that of the first run named."""
    for name in names:
        if is_run(name) and not members(Path(name)):
            _use_one_thread()
            return load_run(scenario, name, transfer=transfer)[1]
    return scenario


def evaluate_named(
    scenario: Scenario, names: list[str], episodes: int, seed: int, *, transfer: bool
) -> dict[str, Evaluation]:
    """Run policies over seeded episodes, by their names.

    Args:
        scenario, episodes, seed: as for `evaluate`.
        names: what `load_policy` takes.
        transfer: as for `trainers.runs.loading.load_run`.

    Raises:
        InputError: there is no such policy, or a run does not fit the scenario.
    """
    # All are looked up before the first is played, which may take its time.
    found = [player_named(scenario, name, seed, "--policy", transfer=transfer) for name in names]
    return {
        name: evaluate(own, player, episodes, seed)
        for name, (own, player) in zip(names, found, strict=True)
    }


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
    breakdown: bool,
    ahead: Ahead,
    keep_episode: bool = False,
) -> tuple[list[Evaluation], str, FirstEpisode | None]:
    """Run policies by what `load_policy` takes.

    Where a layout is drawn once for a run, every run plays in its own, all else in that of the
    first run; by transfer, that is where all of them play.

    Args:
        scenario, episodes, seed, transfer: as for `evaluate_named`.
        names: the policies.
        starts: policies that the planner starts from.
        budget: what the planner spends; None for the usual.
        sampled: draw trained policies' actions rather than take the most probable.
        breakdown: also tell each node and each AUV apart.
        ahead: how trained policies search before the first slot.
        keep_episode: record the first episode of the policy, of which there must be one.

    Returns:
        the evaluations, who plays in which layout, and the first episode, if it is asked for.

    Raises:
        InputError: one is neither, or does not fit the scenario.
    """
    runs = [name for name in names if is_run(name)]
    if sampled:
        _need_trained("--sampled", names)
    if ahead.option:
        ahead.check(names, sampled=sampled)
    if keep_episode and len(names) != 1:
        raise InputError(f"--save-episode: keeps that of one --policy, not of {len(names)}")
    layout = with_layout_of_runs(scenario, [*names, *starts], transfer=transfer)
    planner = None
    if starts or budget is not None:
        if "planner" not in names:
            raise InputError("--planner-…: there is no planner without --policy planner")
        planner = started_planner(layout, starts, budget or DEFAULT_BUDGET, seed, transfer=transfer)
    players = _players(scenario, layout, names, seed, transfer=transfer, sampled=sampled)
    if planner is not None:
        players = [
            (own, planner if name == "planner" else player)
            for name, (own, player) in zip(names, players, strict=True)
        ]
    if ahead.option:
        players = [
            (own, ahead.searched(player, seed) if is_trained(name) else player)
            for name, (own, player) in zip(names, players, strict=True)
        ]
    called = players[0][1].name if ahead.option else names[0]
    first_episode = FirstEpisode(called, seed) if keep_episode else None
    results = [
        evaluate(own, player, episodes, seed, breakdown=breakdown, observe=first_episode)
        for own, player in players
    ]
    others = [name for name in names if name not in runs]
    first = next((name for name in [*names, *starts] if is_run(name)), "")
    where = f", {listed(others)} in that of {first}" if others else ""
    return results, f"each run in its own layout{where}", first_episode


def record_named(
    scenario: Scenario, names: list[str], seed: int, *, transfer: bool, sampled: bool
) -> list[Recording]:
    """An episode of each policy, in the layouts that `evaluate_all` plays in.

    Args:
        scenario, names, seed, transfer, sampled: as there.

    Raises:
        InputError: one is no policy, or does not fit the scenario.
    """
    if sampled:
        _need_trained("--sampled", names)
    layout = with_layout_of_runs(scenario, names, transfer=transfer)
    players = _players(scenario, layout, names, seed, transfer=transfer, sampled=sampled)
    return [
        record_player(own, player, seed, name)
        for name, (own, player) in zip(names, players, strict=True)
    ]


def _players(
    scenario: Scenario,
    layout: Scenario,
    names: list[str],
    seed: int,
    *,
    transfer: bool,
    sampled: bool,
) -> list[tuple[Scenario, Policy]]:
    """The policies, and what each plays: runs their own layout, others that of `layout`.

    All are looked up before the first is played, which may take its time.
    """
    return [
        player_named(
            scenario if is_run(name) and not transfer else layout,
            *(name, seed, "--policy"),
            transfer=transfer,
            sampled=sampled,
        )
        for name in names
    ]


def _need_trained(option: str, names: list[str]) -> None:
    """Refuse an option that is about trained policies where there is none.

    Raises:
        InputError: none of them is.
    """
    if not any(map(is_trained, names)):
        raise InputError(f"{option}: none of the policies is a trained one")


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
    named = [
        player_named(scenario, name, seed, "--planner-start", transfer=transfer) for name in starts
    ]
    return PlannerPolicy(budget, warm=[policy for _, policy in named])


def player_named(
    scenario: Scenario,
    policy: str,
    seed: int,
    option: str,
    *,
    transfer: bool,
    sampled: bool = False,
) -> tuple[Scenario, Policy]:
    """The policy that an option names, and the scenario that it plays."""
    if is_run(policy):
        _use_one_thread()
    return named_policy(scenario, policy, seed, option, transfer=transfer, sampled=sampled)


def _use_one_thread() -> None:
    """More threads than one gain nothing on networks of this size."""
    import torch

    torch.set_num_threads(1)
