"""What charging would bring."""

from iout_marl.core.ranges import Ranges
from iout_marl.core.state import State
from iout_marl.parts.base import Context
from iout_marl.parts.entry.base import Entry, entries
from iout_marl.physics.arrays import Array


@entries.register("harvests")
class Harvests(Entry):
    """Energy that every node would harvest in a slot of charging from the AUV's cell."""

    unit = "J"
    feeds_node_network = True
    rows = "nodes"

    def ranges(self) -> Ranges:
        scale = self.world.representation.energy_ranges().scale[0]
        return Ranges.uniform(self.size, 0.0, float(self.xp.max(self._seen)), float(scale))

    def setup(self, world: Context) -> None:
        super().setup(world)
        # By offset, as energies are written.
        harvested_j = world.link.harvested_w * world.link.slot_s
        self._seen = world.representation.energies(harvested_j)

    def __call__(self, state: State) -> Array:
        link = self.world.link
        return link.at(self._seen, link.offset(state.cell[:, :, None], state.node_cell[:, None, :]))
