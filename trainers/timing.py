"""How the time of an iteration is shared between its phases."""

from __future__ import annotations

import time
from collections import defaultdict


class PhaseTimer:
    """A stopwatch that books the time since its last call to a phase.

    On an accelerator it measures how long the work took to hand over, not to do.

    Attributes:
        seconds: of each phase.
    """

    def __init__(self) -> None:
        self._last = time.perf_counter()
        self.seconds: dict[str, float] = defaultdict(float)

    def __call__(self, phase: str) -> None:
        """Book the time since the last call, or since the start, to a phase."""
        now = time.perf_counter()
        self.seconds[phase] += now - self._last
        self._last = now

    def log(self, steps: int) -> dict[str, float]:
        """`speed/…` of an iteration of that many environment steps, by TensorBoard tag."""
        total = sum(self.seconds.values())
        share = {phase: seconds / total for phase, seconds in self.seconds.items()}
        return {
            "speed/env_steps_per_s": steps / total,
            "speed/rollout_share": 1 - share["learn"],
            "speed/environment_share": share.get("environment", 0.0),
            "speed/inference_share": share["inference"],
            "speed/learn_share": share["learn"],
        }
