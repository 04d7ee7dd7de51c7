"""How long ago the AUV saw each node."""

from iout_marl.core.representation import Ranges
from iout_marl.core.state import State
from iout_marl.parts.observation.base import Entry, entries
from iout_marl.physics.arrays import Array


@entries.register("unseen_for")
class UnseenFor(Entry):
    """How many slots ago each node's age and energy were what the AUV knows of them."""

    unit = "slots"

    @property
    def size(self) -> int:
        return self.world.scenario.num_nodes

    def ranges(self) -> Ranges:
        return self.world.representation.duration_ranges()

    def __call__(self, state: State) -> Array:
        now = self.xp.astype(state.slot, self.world.backend.dtype)[:, None, None]
        return self.world.representation.durations(now - state.seen_slot)
