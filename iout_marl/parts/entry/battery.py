"""How much energy the AUV has."""

from iout_marl.core.state import State
from iout_marl.parts.base import Context
from iout_marl.parts.entry.base import Entry, entries
from iout_marl.physics.arrays import Array
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import invalid


@entries.register("battery")
class Battery(Entry):
    """The share of its battery that the AUV has left."""

    def check(self, scenario: Scenario) -> None:
        if not scenario.vehicle.part.is_limited:
            raise invalid(
                ("observation", "entries"),
                f"battery: there is none with vehicle {scenario.vehicle.kind!r}",
            )

    def setup(self, world: Context) -> None:
        super().setup(world)
        self._per_j = world.backend.floats(1 / world.scenario.vehicle.part.capacity_j)

    def __call__(self, state: State) -> Array:
        return (state.battery_j * self._per_j)[..., None]
