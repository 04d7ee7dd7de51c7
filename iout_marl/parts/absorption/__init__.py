"""Absorption: what sea water takes of sound along the way."""

from iout_marl.parts.absorption.base import Absorption, absorptions

__all__ = ["Absorption", "absorptions"]
