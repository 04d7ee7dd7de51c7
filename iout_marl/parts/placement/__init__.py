"""Placement: where the nodes lie at the start of an episode."""

from iout_marl.parts.placement.base import Placement, placements

__all__ = ["Placement", "placements"]
