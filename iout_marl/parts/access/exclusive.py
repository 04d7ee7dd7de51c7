"""One uplink at a time."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from iout_marl.core.reasons import COLLISION, Reason
from iout_marl.core.split import Split
from iout_marl.parts.access.base import Access, Floats, Request, Uplinks, access_rules
from iout_marl.physics.arrays import Array


@access_rules.register("exclusive")
class Exclusive(Access):
    """One uplink a slot in the whole network; two or more all fail, their energy spent."""

    def max_uplinks_per_slot(self, num_auvs: int) -> int:  # noqa: ARG002
        return 1

    def __call__(self, request: Request, split: Split) -> Uplinks:
        xp = self.xp
        sending = self.to_nearest(request)
        spent_j = xp.where(sending, split.required_j, self._zero)
        if self._num_auvs == 1:
            return Uplinks(sending, spent_j)
        number = xp.sum(xp.astype(sending, spent_j.dtype), axis=1)
        return Uplinks(sending & (number == 1)[:, None], spent_j)

    def why_lost(self, request: Request, split: Split) -> Mapping[Reason, Array]:
        # A node that sends is heard unless there is another.
        return {**super().why_lost(request, split), COLLISION: request.sends}

    def spoils(self, first: Floats, second: Floats) -> np.typing.NDArray[np.bool_]:
        """Both listen: they collide."""
        collide: np.typing.NDArray[np.bool_] = np.maximum(first, second) < 1
        return collide
