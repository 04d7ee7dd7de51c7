"""What slots leave to chance: numbers that are drawn beforehand, and passed in.

A world never draws: the same numbers lead to the same episode, on every array library, in a batch
and alone. Its parts say what they take of `Chance` in a slot.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

from iout_marl.physics.arrays import Array


class Draw(NamedTuple):
    """Numbers that a slot takes, all independent of one another and of those of other slots."""

    distribution: Literal["normal", "uniform"]  # standard normal, or uniform over [0, 1)
    shape: tuple[int, ...]


class Chance(NamedTuple):
    """The numbers of a slot. Fields that nobody takes have no columns: their last axis is 0."""

    fading: Array  # (envs, auvs, nodes) normal: what shadowing changes by
    wind: Array  # (envs, 1) normal: what the wind changes by
    current: Array  # (envs, 2) normal: what the current changes by along x and y
    arrival: Array  # (envs, auvs, 1 + rounds) uniform: which of the packets sent get lost

    def map(self, function: Callable[[Array], Array]) -> Chance:
        """The numbers with `function` applied to every array."""
        return Chance(*(function(array) for array in self))


#: By field: its axes behind that of the environments, where nobody takes it.
_NONE = {"fading": (0, 0), "wind": (0,), "current": (0,), "arrival": (0, 0)}


def shape_of(name: str, draws: dict[str, Draw], num_envs: int) -> tuple[int, ...]:
    """The shape of a field of `Chance`, environments first.

    Args:
        name: of the field.
        draws: what is drawn, for each environment.
        num_envs: environments.
    """
    return (num_envs, *(draws[name].shape if name in draws else _NONE[name]))
