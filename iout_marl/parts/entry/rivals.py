"""Which nodes other AUVs are nearer to."""

import numpy as np

from iout_marl.core.ranges import Ranges
from iout_marl.core.state import State
from iout_marl.parts.base import Context
from iout_marl.parts.entry.base import entries
from iout_marl.parts.entry.steps import StepsTo, by_column
from iout_marl.physics.arrays import Array, cast, lookup

_TOO_FAR = 1e9


@entries.register("rivals")
class Rivals(StepsTo):
    """How much farther every node is from the AUV than from the nearest other one.

    The columns are: that difference, in tens of cells, 0 of a lone AUV; and the share of the AUVs
    that are nearer to the node than this one.
    """

    unit = "10 cells"
    rows = "nodes"
    columns = 2

    def setup(self, world: Context) -> None:
        super().setup(world)
        self._per_auv = world.backend.floats(1 / world.scenario.num_auvs)
        #: (auvs, other auvs, 1): no AUV is a rival of its own.
        self._too_far = world.backend.floats(_TOO_FAR * np.eye(world.scenario.num_auvs)[..., None])

    def ranges(self) -> Ranges:
        most = self._bounds[3][1]
        return by_column(self.size, [(-most, most), (0, 1)])

    def __call__(self, state: State) -> Array:
        xp, dtype = self.xp, self.world.backend.dtype
        cell, node = state.cell[:, :, None], state.node_cell[:, None, :]
        offset = self.world.link.grid_offset(node, cell)
        distance = lookup(xp, self._tables[3], offset)
        if self._num_auvs == 1:
            return xp.concat([xp.zeros_like(distance)] * 2, axis=-1)
        # (envs, auvs, other auvs, nodes)
        others = distance[:, None, :, :] + self._too_far
        nearer = cast(xp, others < distance[:, :, None, :], dtype)
        columns = distance - xp.min(others, axis=2), xp.sum(nearer, axis=2) * self._per_auv
        return xp.concat(columns, axis=-1)
