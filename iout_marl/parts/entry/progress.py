"""How much of the episode is left."""

from iout_marl.core.ranges import Ranges
from iout_marl.core.state import State
from iout_marl.parts.base import Context
from iout_marl.parts.entry.base import Entry, entries
from iout_marl.parts.entry.steps import by_column
from iout_marl.physics.arrays import Array, cast


@entries.register("progress")
class Progress(Entry):
    """How the ages stand, and how much of the episode is left.

    The columns are: slots that are left, over themselves and 50; slots that are over, likewise; the
    mean age over 2 K/M slots, and the highest, up to 4; the share of nodes that can pay an
    uplink to the AUV's cell.
    """

    columns = 5

    def setup(self, world: Context) -> None:
        super().setup(world)
        scenario, floats = world.scenario, world.backend.floats
        self._slots, self._half, self._most = (
            floats(float(scenario.num_slots)),
            floats(50.0),
            floats(4.0),
        )
        self._per_turn = floats(scenario.num_auvs / (2 * scenario.num_nodes))
        self._per_node = floats(1 / scenario.num_nodes)

    def ranges(self) -> Ranges:
        return by_column(self.size, [(0, 1), (0, 1), (0, 4), (0, 4), (0, 1)])

    def __call__(self, state: State) -> Array:
        xp, world, dtype = self.xp, self.world, self.world.backend.dtype
        over = cast(xp, state.slot, dtype)[:, None]
        left = self._slots - over
        age, link = world.view.age(state), world.link
        here = link.offset(state.cell[:, :, None], state.node_cell[:, None, :])
        pays = world.view.energy_j(state) > link.at(link.slot_uplink_j, here)
        columns = (
            left / (left + self._half),
            over / (over + self._half),
            xp.minimum(xp.sum(age, axis=-1) * self._per_node * self._per_turn, self._most),
            xp.minimum(xp.max(age, axis=-1) * self._per_turn, self._most),
            xp.sum(cast(xp, pays, dtype), axis=-1) * self._per_node,
        )
        return xp.stack([xp.broadcast_to(each, state.cell.shape) for each in columns], axis=-1)
