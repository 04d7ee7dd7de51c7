"""Duplexing: how charging and uplink share the slot."""

from iout_marl.parts.duplex.base import Duplex, duplexes

__all__ = ["Duplex", "duplexes"]
