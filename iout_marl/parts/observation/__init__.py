"""Entries of an observation."""

from iout_marl.parts.observation.base import Entry, entries

__all__ = ["Entry", "entries"]
