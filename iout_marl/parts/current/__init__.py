"""Current: how the water moves."""

from iout_marl.core.current import Frames, Wander
from iout_marl.parts.current.base import DRIFTS, Current, currents

__all__ = ["DRIFTS", "Current", "Frames", "Wander", "currents"]
