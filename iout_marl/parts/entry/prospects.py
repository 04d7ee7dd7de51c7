"""What each move would make of every node."""

from iout_marl.core.ranges import Ranges
from iout_marl.core.state import State
from iout_marl.parts.base import Context
from iout_marl.parts.entry.base import Entry, entries
from iout_marl.parts.entry.prices import MOST_DOUBLINGS, clipped, log_ratio, log_table
from iout_marl.parts.entry.steps import by_column
from iout_marl.physics.arrays import Array, cast


@entries.register("prospects")
class Prospects(Entry):
    """What an AUV could do for every node after a move in each direction.

    The columns are, all from the cell that the move leads to: the energy stored over that of an
    uplink, and the harvest of a slot of charging over that of an uplink, both in doublings; and
    whether a node delivers that is charged and heard in this slot.
    """

    rows = "moves"
    columns = 3

    def setup(self, world: Context) -> None:
        super().setup(world)
        link = world.link
        self._log_price = log_table(self.xp, link.slot_uplink_j)
        log_harvest = log_table(self.xp, link.harvested_w * link.slot_s)
        self._gain = clipped(self.xp, log_harvest - self._log_price)
        self._needed_j = world.needed_j()

    def ranges(self) -> Ranges:
        most = float(MOST_DOUBLINGS) / 4
        return by_column(self.size, [(-most, most), (-most, most), (0, 1)])

    def __call__(self, state: State) -> Array:
        xp, link, dtype = self.xp, self.world.link, self.world.backend.dtype
        # (envs, auvs, directions, nodes)
        cell = self.world.neighbours(state.cell)[..., None]
        offset = link.offset(cell, state.node_cell[:, None, None, :])
        stored_j = self.world.view.energy_j(state)[:, :, None, :]
        columns = (
            log_ratio(xp, stored_j, link.at(self._log_price, offset)),
            link.at(self._gain, offset),
            cast(xp, stored_j >= link.at(self._needed_j, offset), dtype),
        )
        by_row = (*offset.shape[:2], offset.shape[2] * offset.shape[3])
        return xp.concat([xp.reshape(each, by_row) for each in columns], axis=-1)
