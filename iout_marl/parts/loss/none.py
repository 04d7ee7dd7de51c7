"""Packets that all arrive."""

from iout_marl.parts.loss.base import Loss, losses


@losses.register("none")
class NoLoss(Loss):
    """Whatever is sent, and is not spoilt by other uplinks, arrives."""
