"""How urgent it is to hear each node."""

from iout_marl.core.ranges import Ranges
from iout_marl.core.state import State
from iout_marl.parts.base import Context
from iout_marl.parts.entry.base import Entry, entries
from iout_marl.parts.entry.rank import count_greater, ranks
from iout_marl.parts.entry.steps import by_column
from iout_marl.physics.arrays import Array, cast


@entries.register("urgency")
class Urgency(Entry):
    """How old the data of every node are, among those of others.

    The columns are: the age over 2 K/M slots, twice the mean age of nodes that are heard in turn,
    up to 4; the age over itself and 50 slots; how many nodes are older, less the AUV's rank among
    AUVs (see `fleet`), over K; whether as many are older as AUVs come before this one, so that
    AUVs that hear the oldest nodes do not hear the same; how much the age weighs, over the mean.
    """

    rows = "nodes"
    columns = 5

    def setup(self, world: Context) -> None:
        super().setup(world)
        scenario, floats = world.scenario, world.backend.floats
        weights = world.backend.floats([scenario.node_weights])
        self._weights = (weights / self.xp.mean(weights))[:, None, :]
        self._per_turn = floats(scenario.num_auvs / (2 * scenario.num_nodes))
        self._per_node = floats(1 / scenario.num_nodes)
        self._most, self._half = floats(4.0), floats(50.0)

    def ranges(self) -> Ranges:
        most = float(self.xp.max(self._weights))
        return by_column(self.size, [(0, 4), (0, 1), (-1, 1), (0, 1), (0, most)])

    def __call__(self, state: State) -> Array:
        xp, view, dtype = self.xp, self.world.view, self.world.backend.dtype
        age = view.age(state)
        older = cast(xp, count_greater(xp, age), dtype)
        turn = older - ranks(xp, state.cell, dtype)[..., None]
        in_turns = xp.minimum(age * self._per_turn, self._most)
        mine = cast(xp, turn == 0, dtype)
        columns = (in_turns, age / (age + self._half), turn * self._per_node, mine, self._weights)
        return xp.concat([xp.broadcast_to(each, turn.shape) for each in columns], axis=-1)
