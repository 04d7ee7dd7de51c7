"""How much of the episode is over."""

from iout_marl.core.state import State
from iout_marl.parts.entry.base import Entry, entries
from iout_marl.physics.arrays import Array


@entries.register("time")
class Time(Entry):
    """The share of the episode that is over."""

    def __call__(self, state: State) -> Array:
        return self.for_every_auv(self.world.representation.time(state.slot))
