"""How long ago the AUV saw each node."""

from iout_marl.core.ranges import Ranges
from iout_marl.core.state import State
from iout_marl.parts.entry.base import Entry, entries
from iout_marl.physics.arrays import Array
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import invalid


@entries.register("unseen_for")
class UnseenFor(Entry):
    """How many slots ago each node's age and energy were what the AUV knows of them."""

    unit = "slots"
    rows = "nodes"

    def check(self, scenario: Scenario) -> None:
        if scenario.observation.view_range_m is None:
            path = ("observation", "entries")
            raise invalid(path, "unseen_for: everything is seen without observation.view_range_m")

    def ranges(self) -> Ranges:
        return self.world.representation.duration_ranges()

    def __call__(self, state: State) -> Array:
        now = self.xp.astype(state.slot, self.world.backend.dtype)[:, None, None]
        return self.world.representation.durations(now - state.seen_slot)
