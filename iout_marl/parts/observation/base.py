"""Entries of an observation: of what an AUV sees, one after the other."""

from __future__ import annotations

from typing import ClassVar

from iout_marl.core.representation import Ranges
from iout_marl.core.state import State
from iout_marl.parts.base import Part
from iout_marl.physics.arrays import Array
from iout_marl.registry import Registry


class Entry(Part):
    """One or several numbers of an observation, the same for every AUV or one's own.

    Attributes:
        unit: of the numbers, where they are not scaled.
        low, high, scale: the range of the numbers, and what makes them of order one, where
            `ranges` does not say it of each.
        feeds_node_network: whether it has one number for each node, of which the network for
            every node alike (`training.node_network`) is made.
    """

    unit: ClassVar[str] = ""
    low: float = 0.0
    high: float = 1.0
    scale: float = 1.0
    feeds_node_network: ClassVar[bool] = False

    @property
    def size(self) -> int:
        """How many numbers, once it is set up."""
        return 1

    def ranges(self) -> Ranges:
        """The ranges of the numbers, (size,) each, once it is set up."""
        return Ranges.alike(self.size, self.low, self.high, self.scale)

    def for_every_auv(self, values: Array) -> Array:
        """(envs, size) as (envs, auvs, size)."""
        num_auvs = self.world.scenario.num_auvs
        if num_auvs == 1:
            return values[:, None, :]
        shape = (values.shape[0], num_auvs, values.shape[1])
        return self.xp.broadcast_to(values[:, None, :], shape)

    def __call__(self, state: State) -> Array:
        """The numbers, (envs, auvs, size); (envs, 1, size) is for all AUVs alike."""
        raise NotImplementedError


entries: Registry[type[Entry]] = Registry("observation entry", Entry)
