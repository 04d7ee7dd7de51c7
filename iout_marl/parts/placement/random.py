"""Nodes at cells that are drawn at random."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import numpy.typing as npt

from iout_marl.core.grid import Grid
from iout_marl.parts.placement.base import Placement, Redraws, placements
from iout_marl.parts.placement.weights import check_weights
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import NumNodes, Weights, invalid
from iout_marl.scenario.parts import Settings as PartSettings


@placements.register("random")
class Random(Placement):
    """Nodes at cells drawn at random, no two in one cell."""

    class Settings(PartSettings):
        #: Number of nodes K.
        count: NumNodes
        #: Draw anew for every episode, or once for a run (from the run's seed).
        redraw: Literal["run", "episode"] = "episode"
        #: Importance δ_k of each node; null for 1 each.
        weights: Weights | None = None

    settings: Settings

    @property
    def redraws(self) -> Redraws:
        return self.settings.redraw

    @property
    def num_nodes(self) -> int:
        return self.settings.count

    def check(self, scenario: Scenario) -> None:
        num_cells = math.prod(scenario.grid.cells)
        if self.num_nodes > num_cells:
            raise invalid(
                ("nodes", "count"),
                f"is {self.num_nodes}, but the grid has only {num_cells} cells",
                beside=("grid", "cells"),
            )
        check_weights(self.settings.weights, self.num_nodes, "count")

    def draw(self, grid: Grid, rng: np.random.Generator) -> npt.NDArray[np.int64]:
        return grid.all_coordinates()[rng.choice(grid.num_cells, self.num_nodes, replace=False)]
