"""Which family of scenarios is trained next: the further from its bound, the more often."""

from __future__ import annotations

import numpy as np

from iout_marl.scenario.drawing import Draw, Families

#: How much of the running gap each new one replaces.
_STEP = 0.2
#: The share of draws that goes by the weights alone, so that nothing is forgotten.
_FLOOR = 0.3
#: A gap that is not known yet.
_UNKNOWN = -1.0


class Curriculum:
    """Draws families and their strata.

    Each stratum of a family is a part of what it draws, see `ScenarioFamily.strata`. By `gap`, a
    stratum is drawn in proportion to its family's weight times its running gap (the mean AoI over
    the scheduling bound, less 1), but for a floor; those that were not drawn yet count as much as
    the one with the largest gap.

    Args:
        families: what is drawn from.
        kind: `none`, by the weights alone, or `gap`.

    Attributes:
        gaps: the running gap of every stratum, family by family; −1 where there is none yet.
    """

    def __init__(self, families: Families, kind: str) -> None:
        self._kind = kind
        self._strata = [
            (family, stratum)
            for family, member in enumerate(families.members)
            for stratum in range(member.strata)
        ]
        self._weights = np.array(
            [families.weights[i] / families.members[i].strata for i, _ in self._strata]
        )
        self.gaps = [_UNKNOWN] * len(self._strata)

    def shares(self) -> list[float]:
        """How often each stratum is drawn: shares of 1."""
        known = np.array(self.gaps)
        if self._kind == "none" or known.max() <= 0:
            return [float(weight) for weight in self._weights]
        gaps = np.where(known == _UNKNOWN, known.max(), known.clip(0))
        by_gap = self._weights * gaps
        shares = _FLOOR * self._weights + (1 - _FLOOR) * by_gap / by_gap.sum()
        return [float(share) for share in shares]

    def choose(self, rng: np.random.Generator) -> tuple[int, int]:
        """A family and a stratum of it, by their shares."""
        shares = np.array(self.shares())
        return self._strata[int(rng.choice(len(shares), p=shares / shares.sum()))]

    def update(self, draw: Draw, gap: float) -> None:
        """Take in the gap that a draw has come to."""
        i = self._strata.index((draw.family, draw.stratum))
        last = self.gaps[i]
        self.gaps[i] = gap if last == _UNKNOWN else last + _STEP * (gap - last)
