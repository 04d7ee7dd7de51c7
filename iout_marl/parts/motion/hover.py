"""Motion of vehicles that can hold their place."""

from iout_marl.parts.motion.base import motions
from iout_marl.parts.motion.six import Six


@motions.register("hover")
class Hover(Six):
    """As `six`, and a seventh direction stays where the AUV is."""

    steps = (*Six.steps, (0, 0, 0))
