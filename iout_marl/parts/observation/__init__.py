"""How an observation writes what an AUV sees."""

from iout_marl.parts.observation.base import Representation, representations

__all__ = ["Representation", "representations"]
