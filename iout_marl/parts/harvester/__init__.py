"""Harvester: what a node stores of the sound that reaches it."""

from iout_marl.parts.harvester.base import Harvester, harvesters

__all__ = ["Harvester", "harvesters"]
