"""The ranges of the entries of an observation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class Ranges:
    """Bounds of the entries of an observation, and what makes them of order one.

    `scale` is what a network's input may be divided by, and `limit` where the quotient
    may stop, since energies have no natural bound: past a few uplinks' worth, more
    makes no difference.
    """

    low: npt.NDArray[np.float64]
    high: npt.NDArray[np.float64]
    scale: npt.NDArray[np.float64]
    limit: float = 4.0

    @classmethod
    def uniform(cls, size: int, low: float, high: float, scale: float) -> Ranges:
        """The same for so many entries."""
        ones = np.ones(size)
        return cls(low * ones, high * ones, scale * ones)

    @classmethod
    def joined(cls, parts: Sequence[Ranges]) -> Ranges:
        """Those of parts of an observation, one after the other."""
        return cls(
            np.concatenate([part.low for part in parts]),
            np.concatenate([part.high for part in parts]),
            np.concatenate([part.scale for part in parts]),
        )
