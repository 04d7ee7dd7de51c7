"""Entries of an observation."""

from iout_marl.parts.entry.base import Entry, entries

__all__ = ["Entry", "entries"]
