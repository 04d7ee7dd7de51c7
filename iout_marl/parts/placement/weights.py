"""Weights of the nodes, which placements list."""

from __future__ import annotations

from iout_marl.scenario.fields import invalid


def check_weights(weights: tuple[float, ...] | None, num_nodes: int, counted_by: str) -> None:
    """See that there is one for each node.

    Args:
        weights: δ_k; None for 1 each.
        num_nodes: K.
        counted_by: the key of `nodes` that says how many there are.

    Raises:
        pydantic_core.PydanticCustomError: there is not.
    """
    if weights is not None and len(weights) != num_nodes:
        raise invalid(
            ("nodes", "weights"),
            f"must list one weight for each of the {num_nodes} nodes, not {len(weights)}",
            beside=("nodes", counted_by),
        )
