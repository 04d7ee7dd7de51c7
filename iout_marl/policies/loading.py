"""Policies by what a user calls them: a baseline, the folder of a run, or code from outside."""

from __future__ import annotations

import difflib
import os
import re
import shlex
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from iout_marl.errors import InputError, InputTypeError, did_you_mean
from iout_marl.outside import import_named
from iout_marl.policies.named import POLICIES, PRETRAINED, make_baseline
from iout_marl.policies.policy import Policy
from iout_marl.policies.predicting import AskedPolicy, BasePolicy, ObservationPolicy
from iout_marl.scenario import Scenario
from iout_marl.whole import seed_argument, short
from iout_marl.world import pin_layout

if TYPE_CHECKING:
    import torch

    from trainers import RunFolder

#: A policy, a function of observations, or what `load_policy` takes.
AnyPolicy: TypeAlias = str | os.PathLike[str] | Policy | Callable[[Any], Any]
#: Runs that a message names at most.
_NAMED_RUNS = 8
_NOTHING = "neither a baseline nor the folder of a run"


def load_policy(
    source: str | os.PathLike[str],
    *,
    sampled: bool = False,
    device: str | torch.device = "cpu",
) -> BasePolicy:
    """A policy, to be evaluated, or asked in an environment by `predict`.

    Args:
        source: the folder of a run; the name of a baseline; or code of one's own, as
            `MODULE:NAME` or `FILE.py:NAME`: a class of policies that is made without arguments, a
            policy, or a function from (envs, auvs, entries) observations to actions.
        sampled: a trained policy draws its actions, as in its training, rather than take the
            most probable.
        device: where a trained policy's networks compute.

    Raises:
        InputError: there is no such policy, or it cannot be imported or read.
    """
    name = _name_of(source)
    if sampled and not is_trained(name):
        raise InputError(f"sampled: {name} is no trained policy")
    if not is_run(name):
        return _untrained(name, "policy", sampled=sampled)
    _refuse_several(name, "policy")
    from trainers import RunFolder

    trained = RunFolder(name).load_policy(device)
    trained.sampled = sampled
    return trained


def policy_for(scenario: Scenario, policy: AnyPolicy, seed: int = 0) -> tuple[Scenario, BasePolicy]:
    """A policy, and the scenario that it plays.

    Where a layout is drawn once for a run, that is with the layout of the seed, or of the run.

    Args:
        scenario: the scenario.
        policy: an object, or what `load_policy` takes.
        seed: of the layout.

    Raises:
        InputError: no such policy, or one that does not fit the scenario, or no seed.
        InputTypeError: it is no policy.
    """
    seed = seed_argument(seed)
    if isinstance(policy, str | os.PathLike):
        return named_policy(scenario, _name_of(policy), seed)
    return pin_layout(scenario, seed), as_policy(policy)


def named_policy(
    scenario: Scenario,
    name: str,
    seed: int,
    option: str = "policy",
    *,
    transfer: bool = False,
    sampled: bool = False,
) -> tuple[Scenario, BasePolicy]:
    """`policy_for` a name.

    Args:
        scenario, name, seed: as there.
        option: what named the policy, for messages.
        transfer: as for `trainers.runs.loading.load_run`.
        sampled: as for `load_policy`; without effect on others.
    """
    if not is_run(name):
        return pin_layout(scenario, seed), _untrained(name, option, sampled=sampled)
    _refuse_several(name, option)
    run, own = load_run(scenario, name, transfer=transfer)
    trained = run.load_policy()
    trained.sampled = sampled
    return own, trained


def as_policy(policy: Any) -> BasePolicy:
    """A policy or a function of observations as a policy that has `predict`.

    Raises:
        InputTypeError: it is neither.
    """
    if isinstance(policy, BasePolicy):
        return policy
    if isinstance(policy, type) and callable(getattr(policy, "act", None)):
        raise InputTypeError(f"a policy must be an object, not its class: {policy.__name__}(…)")
    if isinstance(policy, Policy) and callable(policy.act):
        return AskedPolicy(policy)
    if callable(policy):
        return ObservationPolicy(policy)
    raise InputTypeError(
        f"a policy needs a name and a method act, or must be callable, not {short(policy)}"
    )


def is_run(name: str) -> bool:
    """Whether a name means a run: it is a folder, and no baseline."""
    return name not in POLICIES and os.path.isdir(name)  # noqa: PTH112 (never raises)


def is_trained(name: str) -> bool:
    """Whether a name means a policy that can draw its actions: a run, or the one of the package."""
    return name == PRETRAINED or is_run(name)


def members(folder: Path) -> list[Path]:
    """The runs in a folder that is no run itself: those of several policies, say.

    Raises:
        InputError: it cannot be read.
    """
    try:
        if _holds_policy(folder):
            return []
        found = [path.parent for path in folder.glob("*/policy.json") if _holds_policy(path.parent)]
    except OSError as error:
        raise InputError(f"{folder}: cannot be read: {error.strerror}") from None
    # By their numbers, where they have any: seed-2 before seed-10.
    return sorted(found, key=lambda path: [int(n) for n in re.findall(r"\d{1,20}", path.name)])


def load_run(scenario: Scenario, name: str, *, transfer: bool) -> tuple[RunFolder, Scenario]:
    """See `trainers.runs.loading.load_run`."""
    from trainers.runs.loading import load_run

    return load_run(Path(name), scenario, transfer=transfer)


def _name_of(source: Any) -> str:
    if not isinstance(source, str | os.PathLike):
        raise InputError(
            "policy: must be a baseline, the folder of a run, MODULE:NAME or FILE.py:NAME, "
            f"not {short(source)}"
        )
    name = os.fsdecode(source)
    try:
        return str(Path(name).expanduser()) if name.startswith("~") else name
    except RuntimeError:  # a user of that name is not known
        return name


def _untrained(name: str, option: str, *, sampled: bool) -> BasePolicy:
    where = f"{option} {name or shlex.quote(name)}"
    if name in POLICIES:
        known = make_baseline(name)
        if is_trained(name):
            known.sampled = sampled  # type: ignore[attr-defined]
        return known
    if ":" not in name:
        raise InputError(f"{where}: {_what_else(name)}")
    try:
        found = import_named(name)
        if isinstance(found, type):
            found = _made(found)
        return as_policy(found)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _made(policy: type) -> Any:
    try:
        return policy()
    except Exception as error:
        raise InputError(
            f"{policy.__name__}() cannot be made: {type(error).__name__}: {error}"
        ) from None


def _refuse_several(name: str, option: str) -> None:
    """Refuse a folder of several runs."""
    found = members(Path(name))
    if not found:
        return
    # As they are written to name all of them.
    word = f"{option} " if option.startswith("-") else ""
    raise InputError(
        f"{option} {name}: holds no trained policy, but folders that do: "
        + " ".join(f"{word}{shlex.quote(str(path))}" for path in found[:_NAMED_RUNS])
        + (f" and {len(found) - _NAMED_RUNS} more" if len(found) > _NAMED_RUNS else "")
    )


def _what_else(name: str) -> str:
    """What the name of no policy is, or was meant to be."""
    if os.path.isfile(name):  # noqa: PTH113 (never raises)
        inside = f"; a policy in it is {name}:NAME" if name.endswith(".py") else ""
        return f"is a file, not the folder of a run{inside}"
    for place in (Path(name), Path("runs", name)):
        # A name that is too long, or a folder that is not there, holds nothing that is near.
        with suppress(OSError):
            runs = [path.name for path in place.parent.iterdir() if _holds_policy(path)]
            for near in difflib.get_close_matches(place.name, runs, 1, cutoff=0.75):
                meant = shlex.quote(str(place.parent / near))
                return f"{_NOTHING}; did you mean {meant}?"
    return f"{_NOTHING}{did_you_mean(name, POLICIES)}"


def _holds_policy(folder: Path) -> bool:
    return all((folder / name).is_file() for name in ("policy.json", "policy.safetensors"))
