"""Slots of a batch of environments, compiled by Numba where it is installed."""

from iout_marl.compiled.choice import SlotChoice
from iout_marl.compiled.player import WorldPlayer
from iout_marl.compiled.slot import CompiledSlot, Played, Rows

__all__ = ["CompiledSlot", "Played", "Rows", "SlotChoice", "WorldPlayer"]
