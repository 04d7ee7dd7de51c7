"""Prices for the sharing bound: the dual is concave, and is climbed by cutting planes.

Each answer of the nodes to some prices bounds the dual from above by a plane. The next
prices are the best for all planes so far within a box around the best prices yet (the
boxstep method; Marsten, Hogan and Blankenship, 1975), a linear programme.
"""

from __future__ import annotations

import time

import numpy as np
import numpy.typing as npt
from scipy.optimize import linprog

from iout_marl.bounds.energy import ROUGH
from iout_marl.bounds.field import Field
from iout_marl.bounds.sharing import Prices, Programme, oldest_age

Floats = npt.NDArray[np.float64]

#: Slots at which prices are given, as far as the episode has them: early ones matter most.
TIMES = (0, 2, 4, 6, 8, 10, 13, 16, 20, 25, 30, 36, 42, 50, 60, 70, 80, 90)
#: Reach of the prices of presence, in cells.
REACH_CELLS = 3.0
#: Half the edge of the first box, in slots of age; how it grows and shrinks; the smallest.
FIRST_BOX, GROWTH, SHRINKAGE, SMALLEST_BOX = 1.0, 1.5, 0.7, 0.01
#: Planes that are kept, of each node.
PLANES = 80
#: Where there is no time for so many answers, this share of it is for a rougher game, in which
#: ages from so many times the number of nodes on count as that.
FEW_ANSWERS, ROUGH_SHARE, ROUGH_OLDEST_PER_NODE = 30, 0.5, 3


def climb(field: Field, seconds: float) -> tuple[float, Prices]:
    """The highest sharing bound found, as a sum of ages, and its prices.

    Where the nodes' answers take long, a game of fewer levels and ages shows the way first.

    Args:
        field: the game, of a TDD scenario.
        seconds: time to spend, about; the nodes are asked once at least, which takes some seconds
            where there are ten.
    """
    begun = time.monotonic()
    point, box = _way_shown(field, seconds)
    dual = _Dual(field, oldest_age(field))
    age_sum, point, _ = _climb(dual, point, box, begun + seconds)
    return age_sum, dual.prices(point)


def _way_shown(field: Field, seconds: float) -> tuple[Floats, float]:
    """Where to begin, and half the edge of the first box."""
    rough = Field.of(field.scenario, ROUGH)
    dual = _Dual(rough, oldest_age(rough, ROUGH_OLDEST_PER_NODE))
    begun = time.monotonic()
    dual.planes(dual.first())
    answer_s = time.monotonic() - begun
    times_as_long = field.num_levels * oldest_age(field) / (rough.num_levels * dual.oldest)
    if answer_s * times_as_long * FEW_ANSWERS < seconds:
        return dual.first(), FIRST_BOX
    return _climb(dual, dual.first(), FIRST_BOX, begun + ROUGH_SHARE * seconds)[1:]


def _climb(dual: _Dual, point: Floats, box: float, deadline: float) -> tuple[float, Floats, float]:
    """The highest value found, where it is, and half the edge of the box by then.

    Args:
        dual: what to climb; its nodes are asked once at least.
        point: where to begin.
        box: half the edge of the first box.
        deadline: when to end.
    """
    best, best_point = -np.inf, point
    planes: list[tuple[Floats, Floats]] = []
    while True:
        slopes, offsets = dual.planes(point)
        planes = [*planes, (slopes, offsets)][-PLANES:]
        value = float((slopes @ point + offsets).sum() - dual.paid_back @ point)
        if value > best:
            best, best_point, box = value, point, box * GROWTH
        else:
            box *= SHRINKAGE
        if time.monotonic() > deadline or box < SMALLEST_BOX:
            return best, best_point, box
        point = _best_within(planes, dual, best_point, box)


def _best_within(
    planes: list[tuple[Floats, Floats]], dual: _Dual, centre: Floats, box: float
) -> Floats:
    """The point of the box at which the planes, added up over nodes, are highest."""
    num_nodes = dual.num_nodes
    slopes = np.concatenate([slope for slope, _ in planes])
    offsets = np.concatenate([offset for _, offset in planes])
    own = np.tile(np.eye(num_nodes), (len(planes), 1))
    low, high = centre - box, centre + box
    low[: dual.num_times] = np.maximum(low[: dual.num_times], 0.0)
    solution = linprog(
        np.concatenate([dual.paid_back, -np.ones(num_nodes)]),
        A_ub=np.hstack([-slopes, own]),
        b_ub=offsets,
        bounds=[*zip(low, high, strict=True), *[(None, None)] * num_nodes],
        method="highs",
    )
    # Where the solver gives up, the prices stay: any are valid.
    return centre if solution.x is None else np.asarray(solution.x[: len(centre)])


class _Dual:
    """The nodes' answers to prices, as points: naming first, then presence.

    Args:
        field: the game.
        oldest: age from which on none are told apart.
    """

    def __init__(self, field: Field, oldest: int) -> None:
        scenario = field.scenario
        self.num_nodes = scenario.num_nodes
        last = scenario.num_slots - 1
        self._slots = (*(slot for slot in TIMES if slot < last), last)
        self.num_times = len(self._slots)
        self._reach_m = REACH_CELLS * scenario.grid.spacing_m
        self.oldest = oldest
        self._programme = Programme(field, oldest)
        prices = self.prices(self.first())
        self._between, self._nearness = prices.between(), prices.nearness(field.distance_m)
        self.paid_back = np.zeros(self.first().shape)
        self.paid_back[: self.num_times] = self._between.sum(axis=0)

    def first(self) -> Floats:
        """Where to begin: what a slot is worth if energy is no matter."""
        point = np.zeros(self.num_times * (1 + self.num_nodes**2))
        point[: self.num_times] = self.num_nodes
        return point

    def prices(self, point: Floats) -> Prices:
        """The prices that a point stands for."""
        free = point[self.num_times :].reshape(self.num_nodes, self.num_nodes, self.num_times)
        return Prices(self._slots, point[: self.num_times], free - free.mean(axis=0), self._reach_m)

    def planes(self, point: Floats) -> tuple[Floats, Floats]:
        """Slope and offset of each node's plane at a point: (nodes, variables), (nodes,)."""
        prices = self.prices(point)
        slopes, offsets = [], []
        for node in range(self.num_nodes):
            wish = self._programme.wish(
                node,
                self._between @ prices.naming,
                self._between @ prices.presence[node].T @ self._nearness,
            )
            felt = self._nearness[:, wish.path] @ self._between
            share = np.eye(self.num_nodes)[node] - 1 / self.num_nodes
            slope = np.concatenate(
                [wish.named @ self._between, (share[:, None, None] * felt).ravel()]
            )
            slopes.append(slope)
            offsets.append(wish.value - slope @ point)
        return np.array(slopes), np.array(offsets)
