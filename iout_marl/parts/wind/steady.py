"""The same wind all the time."""

from iout_marl.parts.wind.base import Wind, winds


@winds.register("steady")
class Steady(Wind):
    """The scenario's `channel.wind_m_per_s` all the time."""
