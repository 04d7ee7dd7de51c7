"""How many nodes and AUVs there are, and which place is one's own."""

import math

from iout_marl.core.ranges import Ranges
from iout_marl.core.state import State
from iout_marl.parts.base import Context
from iout_marl.parts.entry.base import Entry, entries
from iout_marl.parts.entry.rank import ranks
from iout_marl.parts.entry.steps import by_column
from iout_marl.physics.arrays import Array


@entries.register("fleet")
class Fleet(Entry):
    """The sizes of network and fleet, and the AUV's place in it.

    The columns are: doublings of K, of M and of K/M, over 5; the rank of the AUV, which is how many
    come before it in the order of their cells, over M; the share of its battery that is left, 1
    where there is none.
    """

    columns = 5

    def setup(self, world: Context) -> None:
        super().setup(world)
        nodes, auvs = world.scenario.num_nodes, world.scenario.num_auvs
        self._sizes = [math.log2(size) / 5 for size in (nodes, auvs, nodes / auvs)]
        self._constant = world.backend.floats([[self._sizes]])
        self._per_auv = world.backend.floats(1 / auvs)
        vehicle = world.scenario.vehicle.part
        self._per_j = world.backend.floats(1 / vehicle.capacity_j) if vehicle.is_limited else None

    def ranges(self) -> Ranges:
        return by_column(self.size, [*((size, size) for size in self._sizes), (0, 1), (0, 1)])

    def __call__(self, state: State) -> Array:
        xp = self.xp
        rank = ranks(xp, state.cell, self.world.backend.dtype) * self._per_auv
        charge = xp.ones_like(rank) if self._per_j is None else state.battery_j * self._per_j
        sizes = xp.broadcast_to(self._constant, (*rank.shape, 3))
        return xp.concat([sizes, rank[..., None], charge[..., None]], axis=-1)
