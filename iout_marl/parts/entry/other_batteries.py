"""How much energy the other AUVs have."""

from iout_marl.core.ranges import Ranges
from iout_marl.core.state import State
from iout_marl.parts.base import Context
from iout_marl.parts.entry.base import entries
from iout_marl.parts.entry.other_auvs import OtherAuvs
from iout_marl.physics.arrays import Array, lookup
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import invalid


@entries.register("batteries")
class Batteries(OtherAuvs):
    """The share of its battery that each other AUV has left, in the order of `other_auvs`.

    Of AUVs in one cell, that of lower number comes first.
    """

    unit = ""

    def check(self, scenario: Scenario) -> None:
        if scenario.num_auvs == 1:
            raise invalid(("observation", "entries"), "batteries: there is but one AUV")
        if not scenario.vehicle.part.is_limited:
            raise invalid(
                ("observation", "entries"),
                f"batteries: there are none with vehicle {scenario.vehicle.kind!r}",
            )

    def setup(self, world: Context) -> None:
        super().setup(world)
        self._per_j = world.backend.floats(1 / world.scenario.vehicle.part.capacity_j)

    @property
    def size(self) -> int:
        return self.world.scenario.num_auvs - 1

    def ranges(self) -> Ranges:
        return Ranges.uniform(self.size, 0, 1, 1)

    def __call__(self, state: State) -> Array:
        return lookup(self.xp, state.battery_j, self.others(state.cell)) * self._per_j
