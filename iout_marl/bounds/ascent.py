"""Prices for the Lagrangian bound: the dual is concave, and is climbed by cutting planes.

Each answer of the nodes to some prices bounds the dual from above by a plane. The next
prices are the best for all planes so far within a box around the best prices yet (the
boxstep method; Marsten, Hogan and Blankenship, 1975), a linear programme.
"""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from iout_marl.bounds.deadline import OutOfTime, check_time
from iout_marl.bounds.energy import ROUGH
from iout_marl.bounds.finite_game import FiniteGame
from iout_marl.bounds.lagrangian import Programme, Wish, oldest_age
from iout_marl.bounds.prices import Prices

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


class Climbed(NamedTuple):
    """How high a climb came."""

    age_sum: float  # the bound
    prices: Prices
    field: FiniteGame  # the game they are for
    oldest: int  # age from which on none are told apart


def climb(field: FiniteGame, seconds: float) -> Climbed | None:
    """The highest Lagrangian bound found; None where there is no time for any.

    Where the nodes' answers take long, a game of fewer levels and ages shows the way first; where
    there is no time for any but that, its own bound is what there is.

    Args:
        field: the game, of a TDD scenario.
        seconds: time to spend.
    """
    begun = time.monotonic()
    deadline = begun + seconds
    game = _Dual(field, oldest_age(field))
    rough_game = FiniteGame.from_scenario(field.scenario, ROUGH)
    rough = _Dual(rough_game, oldest_age(rough_game, ROUGH_OLDEST_PER_NODE))
    try:
        answer_s = rough.seconds_of_answer(deadline)
    except OutOfTime:
        return None
    answer_s *= field.num_levels * game.oldest / (rough_game.num_levels * rough.oldest)
    way, box = None, FIRST_BOX
    if answer_s * FEW_ANSWERS >= seconds:
        is_time = begun + ROUGH_SHARE * seconds + answer_s < deadline
        way, box = _climb(
            rough, rough.first(), box, begun + ROUGH_SHARE * seconds if is_time else deadline
        )
    top, _ = _climb(game, game.first() if way is None else way.point, box, deadline)
    found = [
        Climbed(place.value, dual.prices(place.point), dual.field, dual.oldest)
        for dual, place in ((rough, way), (game, top))
        if place is not None
    ]
    return max(found, key=lambda climbed: climbed.age_sum, default=None)


class _Place(NamedTuple):
    """A point, and the value of the dual there."""

    value: float
    point: Floats


def _climb(dual: _Dual, point: Floats, box: float, deadline: float) -> tuple[_Place | None, float]:
    """The highest place found, if any, and half the edge of the box by then.

    Args:
        dual: what to climb.
        point: where to begin.
        box: half the edge of the first box.
        deadline: when to end.
    """
    best = None
    planes: list[tuple[Floats, Floats]] = []
    while box >= SMALLEST_BOX:
        try:
            slopes, offsets = dual.planes(point, deadline)
            planes = [*planes, (slopes, offsets)][-PLANES:]
            value = float((slopes @ point + offsets).sum() - dual.paid_back @ point)
            if best is None or value > best.value:
                best, box = _Place(value, point), box * GROWTH
            else:
                box *= SHRINKAGE
            point = _best_within(planes, dual, best.point, box, deadline)
        except OutOfTime:
            break
    return best, box


def _best_within(
    planes: list[tuple[Floats, Floats]], dual: _Dual, centre: Floats, box: float, deadline: float
) -> Floats:
    """The point of the box at which the planes, added up over nodes, are highest.

    Raises:
        OutOfTime: the deadline has come.
    """
    from scipy.optimize import linprog  # slow to import: trainings need other bounds alone

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
        options={"time_limit": max(deadline - time.monotonic(), 0.01)},
    )
    check_time(deadline)
    # Where the solver gives up, the prices stay: any are valid.
    return centre if solution.x is None else np.asarray(solution.x[: len(centre)])


class _Dual:
    """The nodes' answers to prices, as points: naming first, then presence.

    Args:
        field: the game.
        oldest: age from which on none are told apart.
    """

    def __init__(self, field: FiniteGame, oldest: int) -> None:
        scenario = field.scenario
        self.field = field
        self.num_nodes = scenario.num_nodes
        last = scenario.num_slots - 1
        self._slots = (*(slot for slot in TIMES if slot < last), last)
        self.num_times = len(self._slots)
        self._reach_m = REACH_CELLS * max(scenario.grid.edges_m)
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
        # The solver keeps its bounds up to a tolerance.
        naming = np.maximum(point[: self.num_times], 0.0)
        return Prices(self._slots, naming, free - free.mean(axis=0), self._reach_m)

    def seconds_of_answer(self, deadline: float) -> float:
        """How long the nodes take for an answer, about: as many times one node's as there are.

        Raises:
            OutOfTime: the deadline has come.
        """
        begun = time.monotonic()
        self._wish(self.prices(self.first()), 0, deadline)
        return (time.monotonic() - begun) * self.num_nodes

    def _wish(self, prices: Prices, node: int, deadline: float) -> Wish:
        return self._programme.wish(
            node,
            self._between @ prices.naming,
            self._between @ prices.presence[node].T @ self._nearness,
            deadline,
        )

    def planes(self, point: Floats, deadline: float) -> tuple[Floats, Floats]:
        """Slope and offset of each node's plane at a point: (nodes, variables), (nodes,).

        Raises:
            OutOfTime: the deadline has come.
        """
        prices = self.prices(point)
        slopes, offsets = [], []
        for node in range(self.num_nodes):
            wish = self._wish(prices, node, deadline)
            felt = self._nearness[:, wish.path] @ self._between
            share = np.eye(self.num_nodes)[node] - 1 / self.num_nodes
            slope = np.concatenate(
                [wish.named @ self._between, (share[:, None, None] * felt).ravel()]
            )
            slopes.append(slope)
            offsets.append(wish.value - slope @ point)
        return np.array(slopes), np.array(offsets)
