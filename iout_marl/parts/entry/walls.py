"""How far the edges of the grid are."""

import numpy as np

from iout_marl.core.ranges import Ranges
from iout_marl.core.state import State
from iout_marl.parts.base import Context
from iout_marl.parts.entry.base import Entry, entries
from iout_marl.parts.entry.steps import CELLS, by_column
from iout_marl.physics.arrays import Array, lookup


@entries.register("walls")
class Walls(Entry):
    """Cells between the AUV and the edges of the grid, behind and ahead along x, y and z."""

    unit = "10 cells"
    columns = 6

    def setup(self, world: Context) -> None:
        super().setup(world)
        grid = world.grid
        behind = grid.coordinate_table() / CELLS
        far = (np.array(grid.shape) - 1) / CELLS
        self._far = np.concatenate([far, far]).tolist()
        columns = [*behind.T, *(far - behind).T]
        self._tables = [world.backend.floats(column) for column in columns]

    def ranges(self) -> Ranges:
        return by_column(self.size, [(0, far) for far in self._far])

    def __call__(self, state: State) -> Array:
        return self.xp.stack([lookup(self.xp, t, state.cell) for t in self._tables], axis=-1)
