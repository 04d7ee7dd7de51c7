"""Ages of information and the fairness of who is served."""

from __future__ import annotations

from typing import Any

from iout_marl.physics.arrays import Array


def advance(xp: Any, age: Array, delivered: Array, maximum: Array) -> tuple[Array, Array]:
    """Ages after a slot (eq. `AOI_CALC`): 1 on delivery, else one more, up to A_max.

    Args:
        xp: array namespace.
        age: (envs, nodes) ages A_k(t), in slots.
        delivered: (envs, nodes) bool.
        maximum: A_max.

    Returns:
        the ages A_k(t + 1), and 1 for each that A_max has cut short, else 0; (envs,
        nodes) each.
    """
    uncut = xp.where(delivered, 0.0, age) + 1
    new_age = xp.minimum(uncut, maximum)
    return new_age, uncut - new_age


def jain_index(xp: Any, total: Array, total_of_squares: Array, num_nodes: int) -> Array:
    """Jain's index J = (Σ D)²/(K Σ D²) (eq. `jain fairness J`); 0 before any delivery.

    Args:
        xp: array namespace.
        total: (envs,) Σ D over nodes.
        total_of_squares: (envs,) Σ D².
        num_nodes: K.

    Returns:
        (envs,) J, from 1/K (one node served) to 1 (all served alike), or 0.
    """
    return total**2 / (num_nodes * xp.where(total > 0, total_of_squares, xp.ones_like(total)))


def jain_of(xp: Any, deliveries: Array) -> Array:
    """`jain_index` of (…, nodes) deliveries: (…)."""
    squares = xp.vecdot(deliveries, deliveries)
    return jain_index(xp, xp.sum(deliveries, axis=-1), squares, deliveries.shape[-1])
