"""Routes for a fleet: nodes shared out, a short tour of each share, cells slot by slot."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

#: Rounds of k-means; it settles within a few.
_ROUNDS = 20
#: How far tours reach: from the middle of a share (0) to each of its nodes (1).
REACHES = (0.0, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.85, 1.0)

Points = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


class Gait(NamedTuple):
    """How AUVs go along the three axes.

    `slots` and `cells` are (3,) each: slots that a move takes, and cells that it covers.
    """

    may_rest: bool  # whether an AUV may stay where it is
    slots: Indices = np.ones(3, dtype=np.int64)
    cells: Indices = np.ones(3, dtype=np.int64)


def tours(
    nodes: Indices,
    starts: Indices,
    num_slots: int,
    shape: tuple[int, int, int],
    gait: Gait,
    waits: Indices | int = 0,
) -> Indices:
    """Routes of a fleet, a choice of them: every AUV round its share of the nodes.

    Sound reaches far, so a tour need not touch its nodes: for each of `REACHES` its
    waypoints lie that far on the way from the middle of the share to the node.

    Args:
        nodes: (nodes, 3) cells from 0.
        starts: (auvs, 3) cells from 0.
        num_slots: how many slots to plan for.
        shape: cells of the grid along each axis.
        gait: how AUVs go.
        waits: (auvs,) slots until they are at their starts.

    Returns:
        (reaches, slots, auvs, 3) cells from 0 that AUVs go to in each slot.
    """
    points = nodes.astype(np.float64)
    stops = -(-len(nodes) // len(starts))
    waypoints = np.empty((len(REACHES), len(starts), stops, 3), dtype=np.int64)
    for auv, own in enumerate(rounds(points, starts.astype(np.float64))):
        middle = own.mean(axis=0)
        padded = own[np.minimum(np.arange(stops), len(own) - 1)]
        for reach, row in zip(REACHES, waypoints, strict=True):
            row[auv] = np.rint(middle + reach * (padded - middle))
    cells = walk(
        np.tile(starts, (len(REACHES), 1)),
        waypoints.reshape(-1, stops, 3),
        num_slots,
        shape,
        gait,
        np.tile(np.broadcast_to(waits, len(starts)), len(REACHES)),
    )
    return cells.reshape(num_slots, len(REACHES), len(starts), 3).swapaxes(0, 1)


def rounds(nodes: Points, starts: Points) -> list[Points]:
    """The nodes that each AUV looks after, in the order of a short round.

    An AUV that looks after none stays about the middle of them all.

    Args:
        nodes: (nodes, 3) coordinates.
        starts: (auvs, 3) coordinates.
    """
    shares = assign_nodes(nodes, starts)
    owned = [nodes[share] if len(share) else nodes.mean(axis=0, keepdims=True) for share in shares]
    return [own[tour_order(own)] for own in owned]


def assign_nodes(nodes: Points, starts: Points) -> list[Indices]:
    """Which nodes each AUV looks after: near one another, and as many as any other's.

    Balanced k-means: centres and nodes are matched at the least sum of squared
    distances, each centre with ⌊K/M⌋ or ⌈K/M⌉ nodes, until no node changes. Shares go to
    the AUVs that start nearest to them.

    Args:
        nodes: (nodes, 3) coordinates.
        starts: (auvs, 3) coordinates.

    Returns:
        indices of its nodes for every AUV; of no node where there are more AUVs than nodes.
    """
    centres, share = starts.astype(np.float64), np.full(len(nodes), -1)
    for _ in range(_ROUNDS):
        before, share = share, _nearest_in_balance(nodes, centres)
        if (share == before).all():
            break
        for i in set(share.tolist()):
            centres[i] = nodes[share == i].mean(axis=0)
    auvs, shares = _assignment(_squared(starts, centres))
    return [np.flatnonzero(share == shares[auv]) for auv in auvs]


def _nearest_in_balance(nodes: Points, centres: Points) -> Indices:
    """The centre of each node, (nodes,), where all centres have as many, give or take one."""
    whole, rest = divmod(len(nodes), len(centres))
    cost = _squared(nodes, centres)
    if not rest:
        places = np.repeat(np.arange(len(centres)), whole)
        return places[_assignment(cost[:, places])[1]]
    places = np.repeat(np.arange(len(centres)), whole + 1)
    # Who fills one of the places that stay empty: only the last one of a centre may.
    filler = np.full(len(places), cost.sum() + 1)
    filler[whole :: whole + 1] = 0
    table = np.vstack([cost[:, places], np.tile(filler, (len(centres) - rest, 1))])
    return places[_assignment(table)[1][: len(nodes)]]


def _assignment(cost: npt.NDArray[np.float64]) -> tuple[Indices, Indices]:
    """Rows and the column of each for which the sum of their costs is least."""
    from scipy.optimize import linear_sum_assignment  # slow to import, and not needed by all

    rows, columns = linear_sum_assignment(cost)
    return rows, columns


def tour_order(nodes: Points) -> Indices:
    """An order of nodes whose closed tour is short, counted in moves from cell to cell.

    Nearest neighbour from the first node on, then reversals of stretches (2-opt) until
    none makes the tour shorter.

    Args:
        nodes: (nodes, 3) coordinates.
    """
    moves = moves_between(nodes, nodes)
    order = nearest_neighbour_order(moves)
    count = len(order)
    while count > 3:
        ahead = np.roll(order, -1)
        legs = moves[order, ahead]
        # Reversing i+1 … j puts the legs (i, j) and (i+1, j+1) in place of two others.
        new = moves[order[:, None], order] + moves[ahead[:, None], ahead]
        gain = np.triu(legs[:, None] + legs - new, 1)
        i, j = np.unravel_index(gain.argmax(), gain.shape)
        if gain[i, j] <= 0:
            break
        order[i + 1 : j + 1] = order[i + 1 : j + 1][::-1].copy()
    return order


def nearest_neighbour_order(moves: Points) -> Indices:
    """From the first node on, always to the nearest that is left; `moves` (nodes, nodes)."""
    order, left = [0], np.ones(len(moves), dtype=np.bool_)
    for _ in range(len(moves) - 1):
        left[order[-1]] = False
        order.append(int(np.where(left, moves[order[-1]], np.inf).argmin()))
    return np.array(order)


def moves_between(first: Points, second: Points) -> Points:
    """Moves from each point to each other, along one axis at a time: (first, second)."""
    return np.abs(first[:, None, :] - second).sum(-1).astype(np.float64)


def walk(
    starts: Indices,
    waypoints: Indices,
    num_slots: int,
    shape: tuple[int, int, int],
    gait: Gait,
    waits: Indices | int = 0,
) -> Indices:
    """Cells of walks round their waypoints, slot by slot, from the nearest waypoint on.

    A move is along the axis of the longest way left, which keeps close to the straight line. Where
    it covers several cells, a waypoint is reached where none brings the walk any nearer.

    Args:
        starts: (walks, 3) cells from 0.
        waypoints: (walks, stops, 3) cells of each walk in the order of its tour.
        num_slots: how many slots to walk.
        shape: cells of the grid along each axis.
        gait: how AUVs go. One that may not rest goes to and fro at a lone waypoint.
        waits: (walks,) slots until they begin.

    Returns:
        (slots, walks, 3) cells that they go to in each slot.
    """
    every, num_stops = np.arange(len(waypoints)), waypoints.shape[1]
    stop = np.abs(waypoints - starts[:, None, :]).sum(-1).argmin(-1)
    # To and fro along the longest axis, which has room for it if any has.
    aside = np.eye(3, dtype=np.int64)[int(np.argmax(shape))] * gait.cells
    waits = np.broadcast_to(waits, len(waypoints))
    last = np.array(shape) - 1
    here, cells = starts, np.empty((num_slots, len(waypoints), 3), dtype=np.int64)
    for slot in range(num_slots):
        for _ in range(num_stops):  # waypoints of one cell are all reached at once
            ways = np.abs(waypoints[every, stop] - here)
            arrived = (2 * ways <= gait.cells).all(-1)
            stop = np.where(arrived, (stop + 1) % num_stops, stop)
        way = waypoints[every, stop] - here
        far = 2 * np.abs(way) > gait.cells
        axis = np.where(far, np.abs(way), 0).argmax(-1)
        step = np.zeros_like(way)
        step[every, axis] = (np.sign(way) * far * gait.cells)[every, axis]
        if not gait.may_rest:
            rests = ~step.any(-1, keepdims=True)
            step = np.where(rests, np.where(here + aside > last, -aside, aside), step)
        is_free = waits == 0
        here = np.where(is_free[:, None], np.clip(here + step, 0, last), here)
        waits = np.where(is_free, np.where(step.any(-1), gait.slots[axis], 1), waits) - 1
        cells[slot] = here
    return cells


def _squared(first: Points, second: Points) -> Points:
    squared: Points = ((first[:, None, :] - second) ** 2).sum(-1).astype(np.float64)
    return squared
