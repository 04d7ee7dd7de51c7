"""Moves over several slots, as a recording has them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]


def progress(transit_slots: Integers) -> Floats:
    """(slots + 1, auvs) share of its move that each AUV under way has behind it, else 0.

    Args:
        transit_slots: (slots + 1, auvs) slots until each move ends, 0 for nobody under way.
    """
    done = np.zeros(transit_slots.shape)
    for place in range(1, len(done)):
        done[place] = (done[place - 1] + 1) * (transit_slots[place] > 0)
    return done / np.maximum(done + transit_slots, 1)


def arrives(path: Integers, heading: Integers, transit_slots: Integers) -> Flags:
    """(slots + 1, auvs) whether the move that an AUV is on leads where it heads for.

    One does not that is given up for want of energy, or stopped by another AUV; of one that is not
    over in the end that is not known, and it counts.

    Args:
        path: (slots + 1, auvs, 3) cells that AUVs count as in.
        heading: (slots + 1, auvs, 3) cells that those under way go to.
        transit_slots: as for `progress`.
    """
    found = np.ones(transit_slots.shape, dtype=np.bool_)
    for place in reversed(range(len(found) - 1)):
        is_there = (path[place + 1] == heading[place]).all(axis=-1)
        found[place] = np.where(transit_slots[place + 1] > 0, found[place + 1], is_there)
    return found
