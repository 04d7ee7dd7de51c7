"""Placement: where the nodes lie at the start of an episode."""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from iout_marl.core.grid import Grid
from iout_marl.parts.base import Part
from iout_marl.registry import Registry

#: When nodes are drawn anew.
Redraws: TypeAlias = Literal["never", "run", "episode"]


class Placement(Part):
    """Where the nodes lie."""

    @property
    def redraws(self) -> Redraws:
        """When nodes are drawn.

        `never` where they lie at given cells; `run` where the seed of a run draws their cells
        once; `episode` where every episode draws them anew.
        """
        return "never"

    @property
    def num_nodes(self) -> int:
        """K."""
        raise NotImplementedError

    @property
    def weights(self) -> tuple[float, ...] | None:
        """Importance δ_k of each node; None for 1 each."""
        return getattr(self.settings, "weights", None)

    def draw(self, grid: Grid, rng: np.random.Generator) -> npt.NDArray[np.int64]:
        """Coordinates from 0 of the nodes' cells, (nodes, 3).

        Args:
            grid: the grid.
            rng: drawn from only where nodes are placed at random.
        """
        raise NotImplementedError


placements: Registry[type[Placement]] = Registry("placement", Placement)
