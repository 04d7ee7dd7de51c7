"""Energies in units of what an uplink takes."""

from __future__ import annotations

from typing import Any

from iout_marl.physics.arrays import Array

#: Ratios beyond so many doublings, or halvings, are all alike.
MOST_DOUBLINGS = 8.0
_LEAST_J = 1e-30


def log_table(xp: Any, energy_j: Array) -> Array:
    """Logarithms to base 2 of energies, of which none counts as below 10⁻³⁰ J."""
    return xp.log2(xp.maximum(energy_j, xp.zeros_like(energy_j) + _LEAST_J))


def log_ratio(xp: Any, energy_j: Array, log_price: Array) -> Array:
    """Energies over prices in doublings, between ±`MOST_DOUBLINGS`, over 4."""
    return clipped(xp, log_table(xp, energy_j) - log_price)


def clipped(xp: Any, doublings: Array) -> Array:
    """Doublings between ±`MOST_DOUBLINGS`, over 4."""
    most = xp.zeros_like(doublings) + MOST_DOUBLINGS
    return xp.maximum(xp.minimum(doublings, most), -most) / 4
