"""Loss: which packets that were sent do not arrive."""

from iout_marl.parts.loss.base import Loss, losses

__all__ = ["Loss", "losses"]
