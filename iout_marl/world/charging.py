"""Charging: what the nodes harvest in a slot."""

from __future__ import annotations

from iout_marl.physics.arrays import Array
from iout_marl.world.duplex import Split
from iout_marl.world.link import Link


def charge(link: Link, offset: Array, split: Split) -> Array:
    """Energy that each AUV's sound brings to the node it charges (eq. `E harvested`).

    A node charged by two AUVs gets both.

    Args:
        link: the links.
        offset: (envs, auvs) offsets to the nodes charged.
        split: how the slot is split.

    Returns:
        (envs, auvs) energy in J.
    """
    return link.at(link.harvested_w, offset) * split.charging_s
