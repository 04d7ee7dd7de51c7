"""Nodes at given cells."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import numpy.typing as npt
from pydantic import Field

from iout_marl.core.grid import Grid
from iout_marl.parts.placement.base import Placement, placements
from iout_marl.parts.placement.weights import check_weights
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import MAX_NODES, Cell, NumNodes, Weights, invalid
from iout_marl.scenario.parts import Settings as PartSettings


@placements.register("fixed")
class Fixed(Placement):
    """Nodes at given cells."""

    class Settings(PartSettings):
        #: Cells of the nodes, each as x, y and z counted from 1.
        cells: Annotated[tuple[Cell, ...], Field(min_length=1, max_length=MAX_NODES, strict=False)]
        #: How many of `cells` hold a node, from the first on; null for all. A scenario that lists
        #: cells over one that counts them means all of its own.
        count: NumNodes | None = None
        #: Importance δ_k of each node; null for 1 each.
        weights: Weights | None = None

    settings: Settings

    @property
    def num_nodes(self) -> int:
        return self.settings.count or len(self.settings.cells)

    def check(self, scenario: Scenario) -> None:
        nodes = self.settings
        for i, cell in enumerate(nodes.cells):
            scenario.check_cell(("nodes", "cells", i), cell)
        if nodes.count is not None and nodes.count > len(nodes.cells):
            raise invalid(
                ("nodes", "count"),
                f"is {nodes.count}, but nodes.cells lists only {len(nodes.cells)} cells",
                beside=("nodes", "cells"),
            )
        check_weights(nodes.weights, self.num_nodes, "cells" if nodes.count is None else "count")

    def draw(self, grid: Grid, rng: np.random.Generator) -> npt.NDArray[np.int64]:  # noqa: ARG002
        return np.array(self.settings.cells[: self.num_nodes]) - 1
