"""Fading: by what the levels of links change from slot to slot."""

from iout_marl.parts.fading.base import Fading, fadings

__all__ = ["Fading", "fadings"]
