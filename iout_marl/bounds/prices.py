"""Prices of the Lagrangian bound: p_t and μ_kt(x), as few numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Prices:
    """p_t and μ_kt(x), as few numbers.

    Between the `slots` listed prices run straight. μ_kt(x) is Σ_j w_kjt exp(−d_j(x)/reach),
    where d_j(x) is the distance from x to node j.

    Attributes:
        slots: (times,) slots at which prices are given; the last is the last of the episode.
        naming: (times,) p, in slots of age, from 0.
        presence: (nodes, nodes, times) w_kj; over k they add up to 0.
        reach_m: the reach in m.
    """

    slots: tuple[int, ...]
    naming: Floats
    presence: Floats
    reach_m: float

    def between(self) -> Floats:
        """(slots, times) the weight of each listed slot in every slot."""
        every = np.arange(self.slots[-1] + 1)
        unit = np.eye(len(self.slots))
        return np.stack([np.interp(every, self.slots, row) for row in unit], axis=1)

    def nearness(self, distance_m: Floats) -> Floats:
        """exp(−d_j(x)/reach) from (nodes, cells) distances."""
        return np.exp(-distance_m / self.reach_m)
