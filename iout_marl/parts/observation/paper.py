"""Observations as the paper has them."""

from iout_marl.parts.observation.base import Representation, representations


@representations.register("paper")
class Paper(Representation):
    """Positions in cells, ages in slots, energies in joules."""
