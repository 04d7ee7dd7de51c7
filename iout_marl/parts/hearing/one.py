"""One node a slot."""

from iout_marl.parts.hearing.base import Hearing, hearings


@hearings.register("one")
class One(Hearing):
    """An AUV hears the node that it has chosen and no other, as in the paper."""
