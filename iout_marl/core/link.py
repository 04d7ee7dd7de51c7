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

    Its tables have an entry for each offset of two cells, or, where the channel tells more apart,
    for each of its pairs of cells: "by offset" means either. What is tabulated by the offset of
    cells whatever the channel is, such as the energy of a move, goes by `grid_offset`.

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
        charging_loss_db: by offset: what the sound that charges loses, in dB, in NumPy.
        least_charging_loss_db: the least that it may lose, wherever they are, less what fading
            adds to it at most.
        excess_db: by offset: see `Uplink.excess_db`; only where packets may be lost, in NumPy.
        most_harvested_w: the most that a node harvests from one AUV, wherever they are.
        may_harvest_nothing: whether there is an offset at which it harvests nothing.

    Raises:
        InputError: they are no numbers, or larger than numbers are here.
    """

    @unheard
    def __init__(self, scenario: Scenario, grid: Grid, backend: Backend) -> None:
        if doubt := scenario.harvester.part.doubt(scenario):
            warn_once(doubt)
        self.budget = LinkBudget(scenario)
        self._scenario = scenario
        self.slot_s = scenario.slot_s
        self._longest_uplink_s: float = self.slot_s * scenario.duplex.part.longest_uplink
        self._xp = backend.xp
        self._origin = backend.integers(grid.offset_origin)
        self._pairs = pairs = scenario.channel.part.pairs(grid)
        way_m = grid.offset_distances_m() if pairs is None else pairs.way_m
        way_m = distance_m = bounded(way_m, 0.0, FARTHEST_M)
        if scenario.grid.own_cell_distance == "mean":
            distance_m = np.where(way_m == 0, mean_distance_in_box(grid.edges_m), way_m)
            distance_m = bounded(distance_m, 0.0, FARTHEST_M)
        if pairs is None:
            charging_khz = self.budget.charging_frequency_khz
            charging_db = self.budget.attenuation_db(distance_m, charging_khz)
            least_db = float(self.budget.attenuation_db(0.0, charging_khz))
            power_per_snr_w = self.budget.power_per_snr_w(distance_m)
        else:
            self._row, self._column = backend.integers(pairs.row), backend.integers(pairs.column)
            charging_db, uplink_db = (
                self._pair_loss_db(khz)
                for khz in (self.budget.charging_frequency_khz, self.budget.uplink_frequency_khz)
            )
            least_db = float(charging_db.min())
            power_per_snr_w = self.budget.power_per_snr_after_loss_w(uplink_db)
        harvested_w = self.budget.harvested_after_loss_w(charging_db)
        # Beyond this gain a harvest rises no further.
        least_db = least_db - scenario.channel.part.fading.most_db
        self.most_harvested_w = float(self.budget.harvested_after_loss_w(least_db))
        self.charging_loss_db, self.least_charging_loss_db = charging_db, least_db
        self.may_harvest_nothing = bool((harvested_w == 0).any())
        uplink_j = self._uplink_j(power_per_snr_w, distance_m)
        in_range = uplink_j < DEAREST_J
        self._dearest_j = float(uplink_j.max(where=in_range, initial=0.0)) or DEAREST_J
        powers = {"power of an uplink": power_per_snr_w, "energy of an uplink": uplink_j}
        self._distances_m, self._uplinks_j = distance_m, uplink_j
        most_w = float(harvested_w.max())
        if scenario.channel.part.fading.is_active:
            most_w = self.most_harvested_w
        check_link(scenario, most_w, powers)
        if scenario.uplink.part.loses:
            self.excess_db = self.budget.excess_db(power_per_snr_w)
        self.distance_m = backend.floats(distance_m)
        self.way_m = self.distance_m if way_m is distance_m else backend.floats(way_m)
        self.harvested_w = backend.floats(harvested_w)
        self.power_per_snr_w = backend.floats(power_per_snr_w)
        self.slot_uplink_j = backend.floats(uplink_j)
        least_s = bounded(self.budget.least_uplink_s(distance_m), 0.0, FARTHEST_M)
        self.least_uplink_s = backend.floats(least_s)
        #: How long an uplink takes at least from the farthest node, in s.
        self.farthest_uplink_s = float(least_s.max())

    def _uplink_j(self, power_per_snr_w: Array, distance_m: ArrayLike) -> Array:
        energy_j = self.budget.required_energy_j(
            power_per_snr_w, self._longest_uplink_s, distance_m
        )
        return bounded(energy_j, 0.0, DEAREST_J)

    @unheard
    def reference_uplink_j(self, distance_m: float) -> float:
        """Energy of an uplink over a distance, to compare others with, in J.

        Where pairs of cells are told apart, it is that of one whose distance comes nearest. Where
        it is out of range, it is the most that any uplink in range takes.
        """
        if self._pairs is None:
            energy_j = float(self._uplink_j(self.budget.power_per_snr_w(distance_m), distance_m))
        else:
            energy_j = float(self._uplinks_j[self._nearest(distance_m)])
        return energy_j if energy_j < DEAREST_J else self._dearest_j

    def loss_db(self, distance_m: float, frequency_khz: float) -> float:
        """Loss over a distance in dB; of pairs that are told apart, of one that comes nearest."""
        if self._pairs is None:
            return float(self.budget.attenuation_db(distance_m, frequency_khz))
        return float(self._pair_loss_db(frequency_khz)[self._nearest(distance_m)])

    def _pair_loss_db(self, frequency_khz: float) -> Array:
        scenario = self._scenario
        return scenario.channel.part.pair_loss_db(scenario, self._pairs, frequency_khz)

    def _nearest(self, distance_m: float) -> int:
        """The first index whose distance comes nearest to one."""
        return int(np.argmin(np.abs(self._distances_m - distance_m)))

    def offset(self, cell: Array, node_cell: Array) -> Array:
        """Index into the tables for cells and nodes' cells of the same (broadcast) shape."""
        if self._pairs is None:
            return self.grid_offset(cell, node_cell)
        return lookup(self._xp, self._row, cell) + lookup(self._xp, self._column, node_cell)

    def grid_offset(self, cell: Array, other: Array) -> Array:
        """Index into tables by code difference, see `Grid`, for cells of the same shape."""
        # In this order: of one AUV and all nodes there is one sum for all.
        return cell + self._origin - other

    def at(self, table: Array, offset: Array) -> Array:
        """Entries of one of the tables, in the shape of `offset`."""
        return lookup(self._xp, table, offset)
