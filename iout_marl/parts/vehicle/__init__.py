"""Vehicle: what energy AUVs have, and what they spend it on."""

from iout_marl.parts.vehicle.base import Vehicle, vehicles

__all__ = ["Vehicle", "vehicles"]
