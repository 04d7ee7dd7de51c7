"""Where the AUV is."""

from iout_marl.core.ranges import Ranges
from iout_marl.core.state import State
from iout_marl.parts.entry.base import Entry, entries
from iout_marl.physics.arrays import Array


@entries.register("position")
class Position(Entry):
    """x, y and z of the AUV's cell, counted from 1."""

    unit = "cells"
    size = 3

    def ranges(self) -> Ranges:
        return self.world.representation.position_ranges()

    def __call__(self, state: State) -> Array:
        return self.world.representation.positions(state.cell)
