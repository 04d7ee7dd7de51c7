"""The acoustic link between every AUV and every node, tabulated over the grid."""

from __future__ import annotations

from iout_marl.physics.arrays import Array, lookup
from iout_marl.scenario import Scenario
from iout_marl.world.backend import Backend
from iout_marl.world.channel import Channel
from iout_marl.world.grid import Grid


class Link:
    """What depends on where an AUV and a node lie to one another.

    Attributes:
        channel: the physics behind the tables.
        slot_s: τ in s.
        distance_m, harvested_w, power_per_snr_w, slot_uplink_j: by offset: the distance,
            the power harvested, the transmit power per unit of SNR, and the energy of
            an uplink over a whole slot; (offsets,) each.
    """

    def __init__(self, scenario: Scenario, grid: Grid, backend: Backend) -> None:
        self.channel = Channel(scenario)
        self.slot_s = scenario.slot_s
        self._xp = backend.xp
        self._origin = backend.integers(grid.offset_origin)
        distance_m = grid.offset_distances() * scenario.grid.spacing_m
        power_per_snr_w = self.channel.power_per_snr_w(distance_m)
        self.distance_m = backend.floats(distance_m)
        self.harvested_w = backend.floats(self.channel.harvested_power_w(distance_m))
        self.power_per_snr_w = backend.floats(power_per_snr_w)
        self.slot_uplink_j = backend.floats(
            self.channel.required_energy_j(power_per_snr_w, self.slot_s)
        )

    def offset(self, cell: Array, node_cell: Array) -> Array:
        """Index into the tables for cells and nodes' cells of the same (broadcast) shape."""
        return cell - node_cell + self._origin

    def at(self, table: Array, offset: Array) -> Array:
        """Entries of one of the tables, in the shape of `offset`."""
        return lookup(self._xp, table, offset)
