"""Vehicles that never tire."""

import numpy as np
import numpy.typing as npt

from iout_marl.parts.vehicle.base import Vehicle, vehicles
from iout_marl.scenario import Scenario


@vehicles.register("unlimited")
class Unlimited(Vehicle):
    """A vehicle whose energy has no end, as in the paper: nothing of it is counted."""

    is_limited = False

    def what_it_adds(self, scenario: Scenario) -> str:  # noqa: ARG002
        return ""

    def propulsion_power_w(self, speed_m_per_s: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return 0.0 * speed_m_per_s
