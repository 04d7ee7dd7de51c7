"""How a slot is divided between charging and uplink."""

from __future__ import annotations

from typing import NamedTuple

from iout_marl.physics.arrays import Array


class Split(NamedTuple):
    """How each AUV's slot is split, (envs, auvs) each."""

    beta: Array  # share for charging, as reported: 0 in FDD, which splits nothing
    charging_s: Array  # time for charging, in s
    uplink_s: Array  # time for the uplink, in s; not 0 where nothing is sent
    required_j: Array  # energy of the uplink alone in the band, in J
