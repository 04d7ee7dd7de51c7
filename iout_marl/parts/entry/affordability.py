"""What the nodes have stored, in units of what their uplinks take."""

from iout_marl.core.ranges import Ranges
from iout_marl.core.state import State
from iout_marl.parts.base import Context
from iout_marl.parts.entry.base import Entry, entries
from iout_marl.parts.entry.prices import MOST_DOUBLINGS, log_ratio, log_table
from iout_marl.parts.entry.steps import by_column
from iout_marl.physics.arrays import Array, cast


@entries.register("affordability")
class Affordability(Entry):
    """How much every node has stored, over what an uplink takes.

    The columns are: stored energy over that of an uplink to the node's own cell, and to the cell
    of the AUV, both in doublings; whether the latter is paid; what share of its store is full (0
    where stores have no limit).
    """

    rows = "nodes"
    columns = 4

    def setup(self, world: Context) -> None:
        super().setup(world)
        self._log_price = log_table(self.xp, world.link.slot_uplink_j)
        capacity_j = world.scenario.storage.part.capacity_j
        self._per_j = world.backend.floats(0.0 if capacity_j is None else 1 / capacity_j)

    def ranges(self) -> Ranges:
        most = float(MOST_DOUBLINGS) / 4
        return by_column(self.size, [(-most, most), (-most, most), (0, 1), (0, 1)])

    def __call__(self, state: State) -> Array:
        xp, link, dtype = self.xp, self.world.link, self.world.backend.dtype
        node, cell = state.node_cell[:, None, :], state.cell[:, :, None]
        stored_j, here = self.world.view.energy_j(state), link.offset(cell, node)
        near = link.offset(node, node)
        pays = cast(xp, stored_j > link.at(link.slot_uplink_j, here), dtype)
        columns = (
            log_ratio(xp, stored_j, link.at(self._log_price, near)),
            log_ratio(xp, stored_j, link.at(self._log_price, here)),
            pays,
            stored_j * self._per_j,
        )
        return xp.concat([xp.broadcast_to(each, here.shape) for each in columns], axis=-1)
