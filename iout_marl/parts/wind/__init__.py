"""Wind: how the noise of the sea changes over time."""

from iout_marl.parts.wind.base import Blowing, Wind, winds

__all__ = ["Blowing", "Wind", "winds"]
