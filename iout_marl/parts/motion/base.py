"""Motion: the directions that an AUV can take."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

from iout_marl.parts.base import Part
from iout_marl.registry import Registry

#: Cells along x, y and z, of each direction.
Steps: TypeAlias = Sequence[tuple[int, int, int]]


class Motion(Part):
    """Which cells an AUV can reach within a slot.

    Attributes:
        steps: of each direction, the cells that it leads along x, y and z.
    """

    steps: Steps

    @property
    def can_rest(self) -> bool:
        """Whether an AUV may stay where it is."""
        return (0, 0, 0) in map(tuple, self.steps)


motions: Registry[type[Motion]] = Registry("motion", Motion)
