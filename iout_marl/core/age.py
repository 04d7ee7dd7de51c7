"""Ages of information and the fairness of who is served."""

from __future__ import annotations

from typing import Any

from iout_marl.physics.arrays import Array


def advance(xp: Any, age: Array, maximum: Array) -> tuple[Array, Array]:
    """Ages after a slot (eq. `AOI_CALC`): 1 on delivery, else one more, up to A_max.

    Args:
        xp: array namespace.
        age: (…, nodes) ages A_k(t), in slots, those of delivered packets set to 0.
        maximum: A_max.

    Returns:
        the ages A_k(t + 1), and what they would be without A_max, one more where that
        has cut them short; (…, nodes) each.
    """
    uncut = age + 1
    return xp.minimum(uncut, maximum), uncut


def jain_index(xp: Any, total: Array, total_of_squares: Array, num_nodes: Array) -> Array:
    """Jain's index J = (Σ D)²/(K Σ D²) (eq. `jain fairness J`); 0 before any delivery.

    Args:
        xp: array namespace.
        total: (envs,) Σ D over nodes.
        total_of_squares: (envs,) Σ D².
        num_nodes: K, as a float.

    Returns:
        (envs,) J, from 1/K (one node served) to 1 (all served alike), or 0.
    """
    # Deliveries are whole numbers: Σ D² is 0 or at least 1.
    return total**2 / xp.maximum(num_nodes * total_of_squares, num_nodes)


def jain_of(xp: Any, deliveries: Array, num_nodes: Array) -> Array:
    """`jain_index` of (…, nodes) deliveries: (…)."""
    squares = xp.vecdot(deliveries, deliveries)
    return jain_index(xp, xp.sum(deliveries, axis=-1), squares, num_nodes)
