"""Placement: where the nodes lie at the start of an episode."""

from __future__ import annotations

from abc import abstractmethod
from typing import Literal, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from iout_marl.core.grid import Grid
from iout_marl.parts.base import Part
from iout_marl.registry import Registry
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import MAX_NODES
from iout_marl.whole import is_number, short, whole_number

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
    @abstractmethod
    def num_nodes(self) -> int:
        """K."""

    @property
    def weights(self) -> tuple[float, ...] | None:
        """Importance δ_k of each node; None for 1 each."""
        return getattr(self.settings, "weights", None)

    def check_stated(self, scenario: Scenario) -> None:  # noqa: ARG002
        try:
            whole_number(self.num_nodes, 1, MAX_NODES)
        except ValueError as error:
            raise self.fault(f"num_nodes {error}") from None
        if self.redraws not in get_args(Redraws):
            known = ", ".join(get_args(Redraws))
            raise self.fault(f"redraws must be one of {known}, not {short(self.redraws)}")
        weights = self.weights
        if weights is not None and not (
            len(weights) == self.num_nodes and all(is_number(weight, 0) for weight in weights)
        ):
            raise self.fault(
                f"weights must be a number from 0 for each of the {self.num_nodes} nodes, "
                f"not {short(weights)}"
            )

    def drawn(self, grid: Grid, rng: np.random.Generator) -> npt.NDArray[np.int64]:
        """What `draw` gives; of a part from outside what `checked_draw` does."""
        entry = self.settings.entry
        with entry.blamed():
            return self.checked_draw(grid, rng) if entry.is_outside else self.draw(grid, rng)

    def checked_draw(self, grid: Grid, rng: np.random.Generator) -> npt.NDArray[np.int64]:
        """What `draw` gives, after a look at it.

        Raises:
            InputError: it is no cells of the grid.
        """
        cells = np.asarray(self.draw(grid, rng))
        shape = (self.num_nodes, 3)
        if cells.shape != shape or cells.dtype.kind not in "iu":
            raise self.fault(
                f"draw must give whole numbers of shape {shape}, the nodes' cells, "
                f"not {cells.dtype} of shape {cells.shape}"
            )
        outside = ((cells < 0) | (cells >= grid.shape)).any(axis=1)
        if outside.any():
            raise self.fault(
                f"draw gives the cell {cells[outside][0].tolist()}; coordinates count from "
                f"0 and stay below {list(grid.shape)}"
            )
        return cells.astype(np.int64)

    @abstractmethod
    def draw(self, grid: Grid, rng: np.random.Generator) -> npt.NDArray[np.int64]:
        """Coordinates from 0 of the nodes' cells, (nodes, 3).

        Args:
            grid: the grid.
            rng: drawn from only where nodes are placed at random.
        """


placements: Registry[type[Placement]] = Registry("placement", Placement)
