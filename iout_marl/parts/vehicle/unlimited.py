"""Vehicles that never tire."""

from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from iout_marl.parts.vehicle.base import MaxSpeed, Vehicle, vehicles
from iout_marl.scenario import Scenario
from iout_marl.scenario.parts import Settings as PartSettings


@vehicles.register("unlimited")
class Unlimited(Vehicle):
    """A vehicle whose energy has no end, as in the paper: nothing of it is counted."""

    class Settings(PartSettings):
        #: Highest speed through the water; null for no limit. In a current, moves that need more
        #: are impossible.
        max_speed_m_per_s: MaxSpeed = None

        hash_defaults: ClassVar[dict[str, Any]] = {"max_speed_m_per_s": None}

    settings: Settings
    is_limited = False

    @property
    def max_speed_m_per_s(self) -> float | None:  # type: ignore[override]
        return self.settings.max_speed_m_per_s

    def what_it_adds(self, scenario: Scenario) -> str:  # noqa: ARG002
        return ""

    def propulsion_power_w(self, speed_m_per_s: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return 0.0 * speed_m_per_s
