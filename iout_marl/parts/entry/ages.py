"""How old the nodes' data are."""

from iout_marl.core.ranges import Ranges
from iout_marl.core.state import State
from iout_marl.parts.entry.base import Entry, entries
from iout_marl.physics.arrays import Array


@entries.register("ages")
class Ages(Entry):
    """Age of Information of every node, as far as the AUV knows it."""

    unit = "slots"
    feeds_node_network = True
    rows = "nodes"

    def ranges(self) -> Ranges:
        return self.world.representation.age_ranges()

    def __call__(self, state: State) -> Array:
        is_limited = self.world.view.is_limited
        age = state.seen_age if is_limited else self.for_every_auv(state.age)
        return self.world.representation.ages(age)
