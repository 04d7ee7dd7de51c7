"""The mean distance between two points of a box."""

from __future__ import annotations

import math
from collections.abc import Sequence

#: Steps of the integral in ln q, and its ends: beyond, less is left than numbers can tell.
_STEP, _FROM, _TO = 0.125, -42.0, 42.0
#: Below it the share is summed as a series, whose terms then shrink fast.
_SERIES_BELOW, _TERMS = 1.0, 20


def mean_distance_in_box(edges: Sequence[float]) -> float:
    """Mean distance between two points drawn uniformly and independently in a box.

    Robbins' constant 0.661707182… times the edge for a cube (Robbins, Amer. Math. Monthly 85
    (1978) 278), a third of the edge for a line. With

        √s = 1/√π ∫ (1 − e^{−s q²}) q⁻² dq,  q from 0 to ∞,

    the mean of the exponential is a product of one factor for each edge, and the integral in
    ln q converges exponentially by the trapezoidal rule.

    Args:
        edges: lengths of the box along its axes, not negative, of which one is above 0.

    Returns:
        the mean distance, in the unit of the edges.
    """
    longest = max(edges)
    total = 0.0
    for step in range(round((_TO - _FROM) / _STEP) + 1):
        q = math.exp(_FROM + step * _STEP)
        lost = 0.0
        for edge in edges:  # 1 − Π (1 − lost) without cancellation
            lost += (1 - lost) * _lost(q * edge / longest)
        total += lost / q
    return longest * total * _STEP / math.sqrt(math.pi)


def _lost(reach: float) -> float:
    """1 − E e^{−(reach·u)²} of the distance u between two points of an edge of length 1."""
    if reach < _SERIES_BELOW:
        terms = (
            (-1) ** (k + 1) * reach ** (2 * k) / (math.factorial(k) * (2 * k + 1) * (k + 1))
            for k in range(1, _TERMS)
        )
        return math.fsum(terms)
    kept = math.sqrt(math.pi) * math.erf(reach) / reach + math.expm1(-(reach**2)) / reach**2
    return 1 - kept
