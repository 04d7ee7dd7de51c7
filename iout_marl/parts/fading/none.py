"""Levels that stay."""

from iout_marl.parts.fading.base import Fading, fadings


@fadings.register("none")
class NoFading(Fading):
    """Levels are what the distance makes them, in every slot."""
