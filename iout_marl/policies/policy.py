"""What a policy is: something that chooses actions for a batch of environments."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
import numpy.typing as npt

from iout_marl.world import State, World

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


def is_deterministic(policy: Policy) -> bool:
    """Whether a policy leaves nothing to chance, as far as it says so itself."""
    said = getattr(policy, "is_deterministic", False)
    return isinstance(said, bool | np.bool_) and bool(said)


class ObservationPolicy:
    """A plain function of the observations as a policy.

    Args:
        function: takes (envs, auvs, entries) float32 observations, returns
            (envs, auvs, entries) integer actions.
        name: what tables call it.
    """

    def __init__(self, function: Callable[[Any], Any], name: str = "") -> None:
        self._function = function
        self.name = name or str(getattr(function, "__name__", "callable"))

    def act(self, world: World, state: State, rng: np.random.Generator) -> Actions:  # noqa: ARG002
        observation = np.asarray(world.observe(state), dtype=np.float32)
        chosen = self._function(observation)
        try:
            return np.asarray(chosen)
        except ValueError:  # ragged; whoever plays it says what an action is
            return np.asarray(chosen, dtype=object)
