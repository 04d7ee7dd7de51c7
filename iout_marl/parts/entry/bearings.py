"""Where the nodes lie, as the AUV sees them."""

from iout_marl.core.state import State
from iout_marl.parts.entry.base import entries
from iout_marl.parts.entry.steps import StepsTo
from iout_marl.physics.arrays import Array


@entries.register("bearings")
class Bearings(StepsTo):
    """Steps along x, y and z from the AUV to every node, and how far it is."""

    unit = "10 cells"
    rows = "nodes"
    columns = 4

    def __call__(self, state: State) -> Array:
        steps = self.steps(state.cell[:, :, None], state.node_cell[:, None, :])
        return self.xp.concat(steps, axis=-1)
