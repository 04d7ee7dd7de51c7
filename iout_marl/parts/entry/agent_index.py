"""Which AUV it is."""

import numpy as np

from iout_marl.core.state import State
from iout_marl.parts.base import Context
from iout_marl.parts.entry.base import Entry, entries
from iout_marl.physics.arrays import Array


@entries.register("agent_index")
class AgentIndex(Entry):
    """Which AUV this is, as M numbers of which one is 1."""

    auvs_are_alike = False

    def setup(self, world: Context) -> None:
        super().setup(world)
        self._identity = world.backend.floats(np.eye(world.scenario.num_auvs))

    @property
    def size(self) -> int:
        return self.world.scenario.num_auvs

    def __call__(self, state: State) -> Array:
        num_envs, num_auvs = state.cell.shape
        return self.xp.broadcast_to(self._identity, (num_envs, num_auvs, num_auvs))
