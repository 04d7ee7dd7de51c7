"""An action space that takes masks in the form in which environments hand them out."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces


class MaskableMultiDiscrete(spaces.MultiDiscrete):
    """A MultiDiscrete that samples by a mask in one piece, too.

    Gymnasium's own wants a tuple with a mask for each entry. Learners want one array, and
    PettingZoo's suites hand `sample` what they find in the observation or the info.
    """

    def sample(self, mask: Any = None, probability: Any = None) -> npt.NDArray[Any]:
        """A random action.

        Args:
            mask, probability: of every choice of every entry, joined end to end in one
                array, or Gymnasium's tuple with an array for each entry; int8 and float64.
        """
        return super().sample(self._by_entry(mask), self._by_entry(probability))

    def _by_entry(self, choices: Any) -> Any:
        if not isinstance(choices, np.ndarray):
            return choices
        total = int(self.nvec.sum())
        if choices.shape != (total,):
            raise ValueError(f"expected one value for each of {total} choices, not {choices.shape}")
        return tuple(np.split(choices, np.cumsum(self.nvec)[:-1]))
