"""Uplink: what a node spends on a packet, and how long that takes."""

from iout_marl.parts.uplink.base import Uplink, uplinks

__all__ = ["Uplink", "uplinks"]
