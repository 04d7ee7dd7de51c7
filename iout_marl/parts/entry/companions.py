"""The other AUVs, one after the other."""

from iout_marl.core.ranges import Ranges
from iout_marl.core.state import State
from iout_marl.parts.base import Context
from iout_marl.parts.entry.base import entries
from iout_marl.parts.entry.rank import ranks
from iout_marl.parts.entry.steps import StepsTo, by_column
from iout_marl.physics.arrays import Array


@entries.register("companions")
class Companions(StepsTo):
    """Each other AUV, in the order of their numbers.

    The columns are: steps along x, y and z to it and how far it is, in tens of cells; its rank less
    one's own (see `fleet`), over the number of AUVs; the share of its battery that is left, 1 where
    there is none.
    """

    rows = "auvs"
    columns = 6

    def setup(self, world: Context) -> None:
        super().setup(world)
        count = world.scenario.num_auvs
        others = [[j for j in range(count) if j != i] for i in range(count)]
        self._others = world.backend.integers(others).reshape(count, count - 1)
        self._per_auv = world.backend.floats(1 / count)
        vehicle = world.scenario.vehicle.part
        self._per_j = world.backend.floats(1 / vehicle.capacity_j) if vehicle.is_limited else None

    def ranges(self) -> Ranges:
        return by_column(self.size, [*self._bounds, (-1, 1), (0, 1)])

    def __call__(self, state: State) -> Array:
        xp, cell, others = self.xp, state.cell, self._others
        steps = self.steps(cell[:, :, None], cell[:, others])
        rank = ranks(xp, cell, self.world.backend.dtype)
        ahead = (rank[:, others] - rank[:, :, None]) * self._per_auv
        if self._per_j is None:
            charge = xp.ones_like(ahead)
        else:
            charge = (state.battery_j * self._per_j)[:, others]
        return xp.concat([*steps, ahead, charge], axis=-1)
