"""Motion of vehicles that keep their depth."""

from iout_marl.parts.motion.base import Motion, motions
from iout_marl.parts.motion.six import Six


@motions.register("planar")
class Planar(Motion):
    """Right, left, up and down as in `six`, and a fifth direction stays: the depth is kept."""

    steps = (*Six.steps[:4], (0, 0, 0))
