"""The current that the AUV is in."""

from iout_marl.core.ranges import Ranges
from iout_marl.core.state import State
from iout_marl.parts.base import Context
from iout_marl.parts.entry.base import Entry, entries
from iout_marl.physics.arrays import Array
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import invalid


@entries.register("current")
class Current(Entry):
    """The current in the AUV's cell in the slot that begins, along x and y.

    Over `vehicle.max_speed_m_per_s`, or where there is none over the strongest that there is.
    """

    def check(self, scenario: Scenario) -> None:
        if not scenario.current.part.flows:
            raise invalid(
                ("observation", "entries"),
                f"current: there is none with current {scenario.current.kind!r}",
            )

    def setup(self, world: Context) -> None:
        super().setup(world)
        assert world.current is not None
        strongest = world.current.strongest_m_per_s or 1.0
        unit = world.scenario.vehicle.part.max_speed_m_per_s or strongest
        self._most = strongest / unit
        self._per_unit = world.backend.floats(1 / unit)

    @property
    def size(self) -> int:
        return 2

    def ranges(self) -> Ranges:
        return Ranges.uniform(2, -self._most, self._most, max(self._most, 1.0))

    def __call__(self, state: State) -> Array:
        assert self.world.current is not None
        velocity = self.world.current.at(state)
        along = [(each * self._per_unit)[..., None] for each in velocity]
        return self.xp.concat(along, axis=-1)
