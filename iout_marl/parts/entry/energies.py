"""How much energy the nodes have."""

from iout_marl.core.ranges import Ranges
from iout_marl.core.state import State
from iout_marl.parts.entry.base import Entry, entries
from iout_marl.physics.arrays import Array


@entries.register("energies")
class Energies(Entry):
    """Stored energy of every node, as far as the AUV knows it."""

    unit = "J"
    feeds_node_network = True
    rows = "nodes"

    def ranges(self) -> Ranges:
        return self.world.representation.energy_ranges()

    def __call__(self, state: State) -> Array:
        is_limited = self.world.view.is_limited
        energy_j = state.seen_energy_j if is_limited else self.for_every_auv(state.energy_j)
        return self.world.representation.energies(energy_j)
