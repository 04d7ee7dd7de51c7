"""How long the AUV is still under way."""

from iout_marl.core.pace import Pace
from iout_marl.core.ranges import Ranges
from iout_marl.core.state import State
from iout_marl.parts.base import Context
from iout_marl.parts.entry.base import Entry, entries
from iout_marl.physics.arrays import Array
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import invalid


@entries.register("transit")
class Transit(Entry):
    """How many slots the AUV's move still takes; 0 where it may choose a direction."""

    unit = "slots"

    def check(self, scenario: Scenario) -> None:
        if not Pace.from_scenario(scenario).takes_slots:
            path = ("observation", "entries")
            raise invalid(
                path, "transit: no move takes longer than a slot", beside=("episode", "slot_s")
            )

    def setup(self, world: Context) -> None:
        super().setup(world)
        self._most_slots = int(Pace.from_scenario(world.scenario).slots.max()) - 1

    def ranges(self) -> Ranges:
        return self.world.representation.wait_ranges(1, self._most_slots)

    def __call__(self, state: State) -> Array:
        slots = self.xp.astype(state.transit_slots, self.world.backend.dtype)
        return self.world.representation.waits(slots, self._most_slots)[..., None]
