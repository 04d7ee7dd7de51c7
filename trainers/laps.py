"""How the time of an iteration is shared."""

from __future__ import annotations

import time
from collections import defaultdict


class Laps:
    """A stopwatch that books the time since its last lap.

    On an accelerator it sees how long the work took to hand over, not to do.
    """

    def __init__(self) -> None:
        self._last = time.perf_counter()
        self.seconds: dict[str, float] = defaultdict(float)

    def __call__(self, name: str) -> None:
        """Book the time since the last lap, or since the start, under a name."""
        now = time.perf_counter()
        self.seconds[name] += now - self._last
        self._last = now

    def shares(self) -> dict[str, float]:
        """What part of all booked time each name has."""
        total = sum(self.seconds.values())
        return {name: seconds / total for name, seconds in self.seconds.items()}
