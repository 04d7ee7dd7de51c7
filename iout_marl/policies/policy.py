"""What a policy is: something that chooses actions for a batch of environments."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
import numpy.typing as npt

from iout_marl.errors import InputError
from iout_marl.registry import blamed, is_own
from iout_marl.world import State, World
from iout_marl.world.actions import ActionCheck

#: (envs, auvs, entries) int: one entry of an action for each of `World.action_sizes`.
Actions: TypeAlias = npt.NDArray[np.int64]


@runtime_checkable
class Policy(Protocol):
    """Chooses an action for every AUV of every environment.

    A policy that leaves nothing to chance may say so by a further attribute, `is_deterministic`:
    in a world without chance its episodes are all the same, and one of them is played.

    Attributes:
        name: what tables call it.
    """

    name: str

    def act(self, world: World, state: State, rng: np.random.Generator) -> Actions:
        """The actions for the next slot.

        Args:
            world: the world, on NumPy: sizes, grid, links, `observe`.
            state: its state.
            rng: for whatever the policy leaves to chance. What is drawn from it in a shape
                that begins with the number of environments has a row of its own for each,
                see `EpisodeStreams`.
        """
        ...


@contextmanager
def most_probable(policy: Any) -> Iterator[None]:
    """Within it, a policy with an attribute `sampled` takes its most probable actions."""
    was_sampled = policy.sampled
    try:
        policy.sampled = False
        yield
    finally:
        policy.sampled = was_sampled


def is_deterministic(policy: Policy) -> bool:
    """Whether a policy leaves nothing to chance, as far as it says so itself."""
    said = getattr(policy, "is_deterministic", False)
    return isinstance(said, bool | np.bool_) and bool(said)


def chosen_by(policy: Policy, world: World, state: State, rng: np.random.Generator) -> Any:
    """What `Policy.act` returns; of a policy from outside that raises, that it does, and where.

    Raises:
        InputError: in place of what it raises.
    """
    code = getattr(policy, "code", type(policy))
    if is_own(getattr(code, "__module__", None) or ""):
        return policy.act(world, state, rng)
    with blamed(f"policy {policy.name}", code):
        return policy.act(world, state, rng)


def take_actions(policy: Policy, chosen: Any, check: ActionCheck, when: str = "") -> Actions:
    """What a policy has chosen, as the world takes it: (envs, auvs, entries).

    Args:
        policy: who has chosen.
        chosen: what `Policy.act` has returned.
        check: knows the shape and the space.
        when: what to add to the policy's name in a message.

    Raises:
        InputError: it does not fit the action space.
    """
    try:
        return check(chosen)
    except ValueError as error:
        said = " ".join(str(error).split())
        said = said if len(said) <= 300 else f"{said[:297]}..."
        raise InputError(f"policy {policy.name}{when}: {said}") from None
