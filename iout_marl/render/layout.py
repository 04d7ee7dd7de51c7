"""Where things go in a picture: who shares a cell with whom, and how far an axis reaches."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from iout_marl.render.snapshot import Floats, Integers

_NODE_RADIUS = 0.36  # cells, of a node alone in its cell
_SPREAD = 0.25  # cells, from the centre of a cell to the nodes that share it
_LAYER_PX = 18  # height of a layer from the side, where there is room
_OVER_NODE, _OVER_NODES = 0.4, 0.62  # cells, from the centre of a cell to an AUV above its nodes
_MOST_STRETCH = 3.0  # of the longest edge of a cell to the shortest, as they are drawn


def drawn_edges(edges_m: npt.ArrayLike, most: float = _MOST_STRETCH) -> Floats:
    """The edges of a cell in a picture, as multiples of the shortest.

    They are in proportion up to `most` to one: the layers of a wide, shallow sea are drawn thicker
    than they are, or nothing would be seen of them.
    """
    edges = np.asarray(edges_m, dtype=np.float64)
    drawn: Floats = np.minimum(edges / edges.min(), most)
    return drawn


def most_stretch(width_px: float, columns: int) -> float:
    """How many times as wide as high a cell may be, for layers that are high enough to be read."""
    return float(np.clip(width_px / (columns * _LAYER_PX), 1.0, _MOST_STRETCH))


def stretched_axes(edges_m: npt.ArrayLike, names: str = "xyz", most: float = _MOST_STRETCH) -> str:
    """Which axes are drawn longer than they are, and how many times; empty where none is."""
    times = drawn_edges(edges_m, most) / np.asarray(edges_m, dtype=np.float64)
    times /= times.min()
    pairs = zip(names, times.tolist(), strict=True)
    return ", ".join(f"{name} × {factor:.2g}" for name, factor in pairs if factor > 1.005)


def place_nodes(cells: Integers, smallest: float) -> tuple[Floats, Floats]:
    """Places of the nodes: those of one cell of the picture stand in a circle.

    Args:
        cells: (nodes, 2) as seen, so that nodes one behind the other share a cell.
        smallest: radius in cells below which a node cannot be seen.

    Returns:
        (nodes, 2) centres and (nodes,) radii, in cells.
    """
    rank, size = _ranks(cells)
    turn = 2 * np.pi * rank / size + np.pi * (0.5 + 0.25 * (size == 4))
    around = _SPREAD * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    alone = size == 1
    centres = cells.astype(np.float64) + np.where(alone[:, None], 0.0, around)
    # Neighbours on the circle just do not touch.
    shared_radius = 0.96 * _SPREAD * np.sin(np.pi / np.maximum(size, 2))
    radii: Floats = np.where(alone, _NODE_RADIUS, np.minimum(shared_radius, _SPREAD))
    return centres, np.maximum(radii, smallest)


def place_auvs(cells: Floats, node_cells: Integers, up: float, rows: int) -> tuple[Floats, Floats]:
    """Places of the AUVs: above the nodes of their cell, and one above the other.

    Above several nodes there is no room in the uppermost row: there they stand below.

    Args:
        cells: (auvs, 2) as seen, of those under way between two.
        node_cells: (nodes, 2) as seen.
        up: the upward direction of the second axis, 1 or −1.
        rows: cells along that axis.

    Returns:
        (auvs, 2) centres in cells, and (auvs,) sizes relative to an AUV alone.
    """
    rank, size = _ranks(cells)
    nodes = (cells[:, None, :] == node_cells[None, :, :]).all(-1).sum(-1)
    is_uppermost = cells[:, 1] == (rows if up > 0 else 1)
    over = np.select(
        [nodes == 0, nodes == 1, is_uppermost], [0.0, _OVER_NODE, -_OVER_NODES], _OVER_NODES
    )
    height = (rank - (size - 1) / 2) * np.minimum(0.36, 0.8 / size) + over
    centres = cells.astype(np.float64)
    centres[:, 1] += up * height
    return centres, np.where((nodes > 0) | (size > 1), 0.8, 1.0)


def _ranks(cells: Integers | Floats) -> tuple[Integers, Integers]:
    """For each row of `cells`, how many equal rows come before it, and how many there are."""
    _, group, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    group = group.reshape(-1)
    order = np.argsort(group, kind="stable")
    first = np.cumsum(counts) - counts
    rank = np.empty_like(group)
    rank[order] = np.arange(len(group)) - first[group[order]]
    return rank, counts[group]


def freest(
    places: Sequence[npt.ArrayLike],
    half_size: tuple[float, float],
    points: Floats,
    segments: Sequence[tuple[Floats, Floats]],
    size: tuple[float, float],
) -> int:
    """Which of the places for a label keeps clearest of what is drawn already.

    Args:
        places: centres of the label, in cells, the preferred first.
        half_size: half the width and half the height of the label, in cells.
        points: (points, 2) centres of what it should not hide.
        segments: ends of lines that it should not hide either.
        size: cells of the picture along both axes, beyond which it should not reach.
    """
    # A line starts under the very thing that the label names.
    steps = np.linspace(0.15, 1, 24)[:, None]
    lines = [a + (b - a) * steps for a, b in segments]
    hidden = np.concatenate([points, *lines])
    cost = np.ones(len(hidden))
    cost[: len(points)] = 10
    scores = []
    for place in places:
        off = np.abs(hidden - np.asarray(place))
        covered = (off < np.asarray(half_size) + 0.3).all(axis=-1)
        low, high = np.asarray(place) - half_size, np.asarray(place) + half_size
        # Over the edge by as little as does not reach the axis' numbers is inside.
        outside = (low < 0.3).any() or (high > np.asarray(size) + 0.7).any()
        scores.append(float(cost[covered].sum()) + 1000 * bool(outside))
    return int(np.argmin(scores))


def axis_top(values: Floats, yardstick: float) -> float:
    """Where the axis of the energies ends.

    Above the highest, but no further above twice the yardstick on behalf of a few high
    ones than the others can be read. It goes by coarse steps, lest the axis move in every
    frame of a film.
    """
    high, middle = float(values.max()), float(np.median(values))
    if high <= 0:
        return _round_above(2 * yardstick)
    return min(_round_above(high), _round_above(max(2 * yardstick, middle)))


def _round_above(value: float) -> float:
    """The first round number that is not below a positive value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(s * power for s in (1, 1.2, 1.6, 2, 4, 6, 8, 10) if s * power >= value))


def round_step(least: float) -> int:
    """The first of 1, 2, 5, 10, 20, … that is not below `least`."""
    power = 1
    while True:
        for step in (1, 2, 5):
            if step * power >= least:
                return step * power
        power *= 10
