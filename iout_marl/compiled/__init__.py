"""Slots of a batch of environments, compiled where llvmlite is installed."""

from iout_marl.compiled.choice import SlotChoice
from iout_marl.compiled.player import WorldPlayer

__all__ = ["SlotChoice", "WorldPlayer"]
