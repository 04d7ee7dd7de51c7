"""Where the nodes are."""

from iout_marl.core.ranges import Ranges
from iout_marl.core.state import State
from iout_marl.parts.entry.base import Entry, entries
from iout_marl.physics.arrays import Array


@entries.register("node_positions")
class NodePositions(Entry):
    """x, y and z of every node's cell, for layouts that change."""

    unit = "cells"

    @property
    def size(self) -> int:
        return 3 * self.world.scenario.num_nodes

    def ranges(self) -> Ranges:
        one = self.world.representation.position_ranges()
        return Ranges.joined([one] * self.world.scenario.num_nodes)

    def __call__(self, state: State) -> Array:
        nodes = self.world.representation.positions(state.node_cell)
        return self.for_every_auv(self.xp.reshape(nodes, (nodes.shape[0], -1)))
