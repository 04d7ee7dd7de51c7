"""Access: who sends on the shared band, and whose packet arrives.

A node that several AUVs hear sends once, to the nearest of them; between AUVs that are
equally near, to the one in the cell of the lower code, so that the order of the AUVs does
not matter.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from iout_marl.core.reasons import TAKEN, Reason
from iout_marl.core.split import Split
from iout_marl.deprecated import warn_renamed
from iout_marl.parts.base import Context, Part
from iout_marl.physics.arrays import Array
from iout_marl.registry import Registry
from iout_marl.scenario import Scenario

Floats = npt.NDArray[np.float64]


class Request(NamedTuple):
    """What the AUVs ask for in a slot, (envs, auvs) each."""

    cell: Array  # code of the AUV's cell
    heard: Array  # node asked for its packet
    node_cell: Array  # code of that node's cell
    sends: Array  # bool: whether it would send if it were alone
    available_j: Array  # J: energy that it has when the uplinks begin
    offset: Array  # offset from the AUV to it, see `Link`

    @property
    def payable_j(self) -> Array:
        """The name of `available_j` in the version before."""
        warn_renamed("Request.payable_j", "Request.available_j")
        return self.available_j


class Uplinks(NamedTuple):
    """What came of it, (envs, auvs) each."""

    delivered: Array  # bool: the packet arrived
    spent_j: Array  # J: energy that the node heard has spent on it


class Access(Part):
    """How uplinks to several AUVs share the band.

    Attributes:
        uplinks_disturb: whether an uplink may be dearer, or fail, because of another one.
        charging_disturbs: whether an AUV that charges drowns uplinks to others meanwhile, once
            it is set up.
    """

    uplinks_disturb = False
    charging_disturbs = False

    def num_bands(self, num_auvs: int) -> int:  # noqa: ARG002
        """How many bands the uplink's band is divided into, one of which an uplink has."""
        return 1

    def max_uplinks_per_slot(self, num_auvs: int) -> int:
        """The most uplinks that can arrive in a slot."""
        return num_auvs

    def check_stated(self, scenario: Scenario) -> None:
        auvs = scenario.num_auvs
        for name, count in {
            "num_bands": self.num_bands(auvs),
            "max_uplinks_per_slot": self.max_uplinks_per_slot(auvs),
        }.items():
            if not (isinstance(count, int) and not isinstance(count, bool) and count >= 1):
                raise self.fault(f"{name}({auvs}) must be a whole number from 1, not {count!r}")

    def setup(self, world: Context) -> None:
        super().setup(world)
        self._link = world.link
        self._zero = world.backend.floats(0.0)
        self._num_auvs = world.scenario.num_auvs
        self._index = world.backend.integers(list(range(self._num_auvs)))

    @abstractmethod
    def __call__(self, request: Request, split: Split) -> Uplinks:
        """The uplinks of a slot."""

    def why_lost(self, request: Request, split: Split) -> Mapping[Reason, Array]:  # noqa: ARG002
        """Why packets that are sent do not arrive, (envs, auvs) bool each; the first that holds
        counts.

        Asked after a slot, for those who want to see it explained; flags of packets that have
        arrived have no effect. A rule of one's own adds to what `super()` gives.
        """
        return {TAKEN: request.sends & ~self.to_nearest(request)}

    def spoils(self, first: Floats, second: Floats) -> Any:  # noqa: ARG002
        """Whether two AUVs' shares β of a slot for charging go ill together; None if none do.

        For planners: β is 1 where an AUV only charges.
        """
        return None

    def to_nearest(self, request: Request) -> Array:
        """Which AUVs' nodes send to them: (envs, auvs) bool."""
        if self._num_auvs == 1:
            return request.sends
        xp = self.xp
        distance_m = self._link.at(self._link.distance_m, request.offset)
        mine, theirs = distance_m[:, :, None], distance_m[:, None, :]
        own_cell, their_cell = request.cell[:, :, None], request.cell[:, None, :]
        # AUVs in one cell that hear one node are alike: here their order does no harm.
        earlier = (their_cell == own_cell) & (self._index[None, :] < self._index[:, None])
        before = (theirs < mine) | ((theirs == mine) & ((their_cell < own_cell) | earlier))
        same_node = request.heard[:, :, None] == request.heard[:, None, :]
        rival = same_node & request.sends[:, None, :] & before
        return request.sends & ~xp.any(rival, axis=2)


access_rules: Registry[type[Access]] = Registry("access", Access)
