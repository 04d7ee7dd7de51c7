"""Motion: the directions that an AUV can take."""

from iout_marl.parts.motion.base import Motion, motions

__all__ = ["Motion", "motions"]
