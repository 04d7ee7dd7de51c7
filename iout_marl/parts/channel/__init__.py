"""Channel: what sound loses on its way, and what power an uplink takes."""

from iout_marl.parts.channel.base import Channel, channels

__all__ = ["Channel", "channels"]
