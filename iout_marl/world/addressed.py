"""The nodes that AUVs name in a slot, and how they lie to them."""

from __future__ import annotations

from typing import NamedTuple

from iout_marl.physics.arrays import Array


class Addressed(NamedTuple):
    """The nodes named, (envs, auvs) int each.

    Where AUVs may name nobody (`auvs.idle_choices`), the place of nobody is that of the last node,
    and the flags say where it counts.
    """

    heard_index: Array  # place of the node heard on the axis of nodes, see `NodeAxis`
    heard_cell: Array  # code of its cell
    heard_offset: Array  # offset from the AUV to it, see `Link`
    charged_index: Array  # the same of the node charged
    charged_offset: Array
    charges: Array | None = None  # bool: somebody is charged; None where nobody cannot be named
    hears: Array | None = None  # bool: somebody is heard; None likewise
