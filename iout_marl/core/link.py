"""The acoustic link between every AUV and every node, tabulated over the grid."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from iout_marl.arrays.backend import Backend
from iout_marl.core.box import mean_distance_in_box
from iout_marl.core.budget import LinkBudget
from iout_marl.core.grid import Grid
from iout_marl.core.limits import DEAREST_J, FARTHEST_M, bounded, check_link, unheard
from iout_marl.errors import warn_once
from iout_marl.physics.arrays import Array, ArrayLike, lookup
from iout_marl.scenario import Scenario


class SlotEnergies(NamedTuple):
    """What a slot brings and takes, at the extremes of the links that a scenario has."""

    link: Link
    offsets: npt.NDArray[np.int64]  # those that an AUV and a node can have
    poorest_j: float  # the least that a node harvests in a slot of nothing but charging
    dearest_j: float  # the most that an uplink over a whole slot takes, alone in the band
    num_slots: int  # slots of an episode


class Link:
    """What depends on where an AUV and a node lie to one another.

    Attributes:
        channel: the physics behind the tables.
        slot_s: τ in s.
        distance_m, harvested_w, power_per_snr_w, slot_uplink_j, least_uplink_s: by offset: the
            distance that sound goes, the power harvested, the transmit power per unit of SNR, the
            energy of an uplink that has the longest time that the duplex part leaves it, a whole
            slot mostly (`limits.DEAREST_J` where no packet can arrive), and the time that an
            uplink takes at least; (offsets,) each.
        way_m: by offset: the way from the centre of one cell to that of the other, 0 within one
            whatever `grid.own_cell_distance` says; (offsets,).

    Raises:
        InputError: they are no numbers, or larger than numbers are here.
    """

    @unheard
    def __init__(self, scenario: Scenario, grid: Grid, backend: Backend) -> None:
        if doubt := scenario.harvester.part.doubt(scenario):
            warn_once(doubt)
        self.budget = LinkBudget(scenario)
        self.slot_s = scenario.slot_s
        self._longest_uplink_s: float = self.slot_s * scenario.duplex.part.longest_uplink
        self._xp = backend.xp
        self._origin = backend.integers(grid.offset_origin)
        way_m = distance_m = bounded(grid.offset_distances_m(), 0.0, FARTHEST_M)
        if scenario.grid.own_cell_distance == "mean":
            own_cell_m = mean_distance_in_box(grid.edges_m)
            distance_m = bounded(grid.offset_distances_m(own_cell_m), 0.0, FARTHEST_M)
        harvested_w = self.budget.harvested_power_w(distance_m)
        power_per_snr_w = self.budget.power_per_snr_w(distance_m)
        uplink_j = self._uplink_j(power_per_snr_w, distance_m)
        in_range = uplink_j < DEAREST_J
        self._dearest_j = float(uplink_j.max(where=in_range, initial=0.0)) or DEAREST_J
        powers = {"power of an uplink": power_per_snr_w, "energy of an uplink": uplink_j}
        check_link(scenario, float(harvested_w.max()), powers)
        self.distance_m = backend.floats(distance_m)
        self.way_m = self.distance_m if way_m is distance_m else backend.floats(way_m)
        self.harvested_w = backend.floats(harvested_w)
        self.power_per_snr_w = backend.floats(power_per_snr_w)
        self.slot_uplink_j = backend.floats(uplink_j)
        least_s = bounded(self.budget.least_uplink_s(distance_m), 0.0, FARTHEST_M)
        self.least_uplink_s = backend.floats(least_s)

    def _uplink_j(self, power_per_snr_w: Array, distance_m: ArrayLike) -> Array:
        energy_j = self.budget.required_energy_j(
            power_per_snr_w, self._longest_uplink_s, distance_m
        )
        return bounded(energy_j, 0.0, DEAREST_J)

    @unheard
    def reference_uplink_j(self, distance_m: float) -> float:
        """Energy of an uplink over a distance, to compare others with, in J.

        Where that is out of range, it is the most that any uplink in range takes.
        """
        energy_j = float(self._uplink_j(self.budget.power_per_snr_w(distance_m), distance_m))
        return energy_j if energy_j < DEAREST_J else self._dearest_j

    def offset(self, cell: Array, node_cell: Array) -> Array:
        """Index into the tables for cells and nodes' cells of the same (broadcast) shape."""
        return cell - node_cell + self._origin

    def at(self, table: Array, offset: Array) -> Array:
        """Entries of one of the tables, in the shape of `offset`."""
        return lookup(self._xp, table, offset)
