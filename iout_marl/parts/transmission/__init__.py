"""Transmission: by what rule sound loses its level between an AUV and a node."""

from iout_marl.parts.transmission.base import Transmission, transmissions

__all__ = ["Transmission", "transmissions"]
