"""Motion: the directions that an AUV can take."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from iout_marl.parts.base import Part
from iout_marl.registry import Registry
from iout_marl.scenario import Scenario
from iout_marl.whole import short

#: Cells along x, y and z, of each direction.
Steps: TypeAlias = Sequence[tuple[int, int, int]]


class Motion(Part):
    """Which cells an AUV can reach within a slot, whatever the edges of a cell are.

    A slot is the time for the longest edge at `auvs.speed_m_per_s`: along others an AUV is slower,
    across several at once it is faster.

    Attributes:
        steps: of each direction, the cells that it leads along x, y and z.
    """

    steps: Steps

    @property
    def can_rest(self) -> bool:
        """Whether an AUV may stay where it is."""
        return (0, 0, 0) in map(tuple, self.steps)

    @property
    def axes_moved(self) -> tuple[bool, ...]:
        """Whether any direction leads along x, y and z."""
        try:
            steps = np.array(self.steps, dtype=np.int64).reshape(-1, 3)
        except (TypeError, ValueError):
            return True, True, True  # `check_stated` refuses them
        return tuple((steps != 0).any(axis=0).tolist())

    def check_stated(self, scenario: Scenario) -> None:  # noqa: ARG002
        try:
            steps = np.array(self.steps)
        except ValueError:  # ragged
            steps = np.array(self.steps, dtype=object)
        if steps.ndim != 2 or steps.shape[1] != 3 or steps.dtype.kind not in "iu":
            raise self.fault(
                "steps must be three whole numbers for each direction, (directions, 3), "
                f"not {short(self.steps)}"
            )
        if len(np.unique(steps, axis=0)) < len(steps):
            raise self.fault("steps: two directions lead the same way")


motions: Registry[type[Motion]] = Registry("motion", Motion)
