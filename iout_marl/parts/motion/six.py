"""The paper's motion."""

from iout_marl.parts.motion.base import Motion, Steps, motions


@motions.register("six")
class Six(Motion):
    """One cell along an axis in every slot, never at rest (eq. `direction`)."""

    # Right, left, up, down, forward, backward.
    steps: Steps = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
