"""Uplink: whose packet arrives."""

from __future__ import annotations

from typing import Any

from iout_marl.physics.arrays import Array
from iout_marl.world.link import Link


def settle(xp: Any, sends: Array, heard: Array, link: Link, offset: Array) -> Array:
    """Which AUVs receive a packet: a node heard by several delivers once, to the nearest.

    Between AUVs that are equally near, the first one receives it.

    Args:
        xp: array namespace.
        sends: (envs, auvs) bool, whether the node heard can send to this AUV.
        heard: (envs, auvs) nodes heard.
        link: the links.
        offset: (envs, auvs) offsets to the nodes heard.

    Returns:
        (envs, auvs) bool.
    """
    num_auvs = heard.shape[1]
    if num_auvs == 1:
        return sends
    index = xp.arange(num_auvs, device=heard.device)
    distance_m = link.at(link.distance_m, offset)
    mine, theirs = distance_m[:, :, None], distance_m[:, None, :]
    before = (theirs < mine) | ((theirs == mine) & (index[None, :] < index[:, None]))
    rival = (heard[:, :, None] == heard[:, None, :]) & sends[:, None, :] & before
    return sends & ~xp.any(rival, axis=2)
