"""The form in which environments hand out observations: vectors or node tables, with masks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from iout_marl.core.ranges import Ranges
from iout_marl.core.table import TableLayout


class ObservationForm:
    """One array, or several by name: the same for all APIs.

    A vector is a Box of its entries; a node table by rows is a Dict of `context`, `nodes` and, if
    there are other AUVs, `auvs`: see `TableLayout.rows`. Where the mask is handed out with the
    observation, it is a Dict with `action_mask`, and the vector is called `observation`.
    Observations of several AUVs are joined end to end, array by array.

    Args:
        ranges: of one AUV's observation.
        layout: of a node table by rows; None for vectors.
        num_masked: choices in the mask that goes with the observation; 0 without one.
    """

    def __init__(self, ranges: Ranges, layout: TableLayout | None, num_masked: int) -> None:
        self._layout = layout
        self._num_masked = num_masked
        self._low, self._high = float32_bounds(ranges)

    def space(self, num_auvs: int = 1) -> spaces.Space[Any]:
        """The observations of some AUVs, joined end to end."""
        low, high = (
            {name: np.concatenate([array] * num_auvs) for name, array in self._named(bound).items()}
            for bound in (self._low, self._high)
        )
        named: dict[str, spaces.Space[Any]] = {
            name: spaces.Box(low[name], high[name], dtype=np.float32) for name in low
        }
        if self._num_masked:
            named["action_mask"] = spaces.MultiBinary(self._num_masked * num_auvs)
        return named["observation"] if list(named) == ["observation"] else spaces.Dict(named)

    def arrays(
        self, vectors: npt.NDArray[np.float32], masks: Callable[[], npt.NDArray[np.int8]]
    ) -> npt.NDArray[Any] | dict[str, npt.NDArray[Any]]:
        """Observations.

        Args:
            vectors: (…, entries).
            masks: gives (…, choices); is not called where masks are not handed out with them.
        """
        if self._layout is None and not self._num_masked:
            return vectors
        named: dict[str, npt.NDArray[Any]] = self._named(vectors)
        if self._num_masked:
            named["action_mask"] = masks()
        return named

    def _named(self, vectors: npt.NDArray[np.float32]) -> dict[str, npt.NDArray[np.float32]]:
        if self._layout is None:
            return {"observation": vectors}
        return {name: np.ascontiguousarray(r) for name, r in self._layout.rows(vectors).items()}


def each_array(function: Callable[[Any], Any], observations: Any) -> Any:
    """What a function makes of observations: of one array, or of each of several by name."""
    if isinstance(observations, Mapping):
        return {name: function(array) for name, array in observations.items()}
    return function(observations)


def box(ranges: Ranges) -> spaces.Box:
    """The vectors whose entries lie within the ranges."""
    return spaces.Box(*float32_bounds(ranges), dtype=np.float32)


def float32_bounds(ranges: Ranges) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Bounds in float32 of whatever lies within the ranges in float64."""
    low, high = ranges.low.astype(np.float32), ranges.high.astype(np.float32)
    low = np.where(low > ranges.low, np.nextafter(low, np.float32(-np.inf)), low)
    high = np.where(high < ranges.high, np.nextafter(high, np.float32(np.inf)), high)
    return low.astype(np.float32), high.astype(np.float32)
