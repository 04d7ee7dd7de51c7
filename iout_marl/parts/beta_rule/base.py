"""Rules for β, the share of a slot that TDD gives to charging."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from iout_marl.core.levels import BEYOND_J, EnergyLevels, Tables
from iout_marl.core.link import SlotEnergies
from iout_marl.core.reasons import Reason
from iout_marl.core.split import Split
from iout_marl.core.whole_levels import WholeLevels, highest
from iout_marl.parts.base import Context, Part
from iout_marl.physics.arrays import Array
from iout_marl.registry import Registry

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]


class BetaRule(Part):
    """How β follows from where an AUV and its node lie, and from what the node has stored.

    The duplex part has the bounds `beta_min` and `beta_max`.

    Attributes:
        has_tables: see `Duplex.has_tables`.
        uplinks_fill_their_time: see `Duplex.uplinks_fill_their_time`.
    """

    has_tables = False
    uplinks_fill_their_time = True

    @staticmethod
    def longest_uplink(bounds: Any) -> float:  # noqa: ARG004
        """As `Duplex.longest_uplink`, within the bounds of the duplex part's settings."""
        return 1.0

    def setup(self, world: Context) -> None:
        super().setup(world)
        backend, link, bounds = world.backend, world.link, world.scenario.duplex
        self._link = link
        self._zero = backend.floats(0.0)
        self._one = backend.floats(1.0)
        self._bounds: Any = bounds
        #: What `physics.beta_star` and `smallest_beta` take last: slot, packet, band, bounds.
        self.interval = (
            link.slot_s,
            world.scenario.uplink.part.packet_bits,
            link.budget.bandwidth_hz,
            self._bounds.beta_min,
            self._bounds.beta_max,
        )

    @abstractmethod
    def split(self, charging_offset: Array, uplink_offset: Array, stored_j: Array) -> Split:
        """Split the slot, as `Duplex.split`."""

    def why_silent(self, split: Split) -> Mapping[Reason, Array]:  # noqa: ARG002
        """As `Duplex.why_silent`: reasons that come before that of the duplex part."""
        return {}

    def energy_never_binds(self, energies: SlotEnergies, bounds: Any) -> bool:  # noqa: ARG002
        """As `Duplex.energy_never_binds`, within the bounds of the duplex part's settings."""
        return False

    def search_links(self, levels: EnergyLevels, offset: Any) -> Tables:
        """As `Duplex.search_tables`; by `search_tables` unless a rule has another way."""
        link = self._link
        return self.search_tables(
            levels,
            link.at(link.harvested_w, offset),
            link.at(link.power_per_snr_w, offset),
            np.minimum(link.at(link.slot_uplink_j, offset), BEYOND_J),
        )

    def check_links(self, levels: WholeLevels, offsets: Integers) -> list[list[list[int]]]:
        """As `Duplex.check_tables`; by `check_rows` unless a rule has another way."""
        link, bounds = self._link, self._bounds
        harvested_w, cost_w = link.harvested_w[offsets], link.power_per_snr_w[offsets]

        def gain_j(beta: Floats) -> Floats:
            required_j = link.budget.required_energy_j(cost_w, (1 - beta) * link.slot_s)
            return np.asarray(beta * link.slot_s * harvested_w - required_j)

        low, high = (np.full(len(offsets), beta) for beta in (bounds.beta_min, bounds.beta_max))
        # What overflows is an uplink that nothing pays.
        with np.errstate(over="ignore", invalid="ignore"):
            least_j, most_j = gain_j(low), highest(gain_j, low, high)
        if np.isnan(least_j).any() or np.isnan(most_j).any():
            raise ArithmeticError
        energies_j = (harvested_w * link.slot_s, link.slot_uplink_j[offsets], least_j, most_j)
        return [
            self.check_rows(levels, *row)
            for row in zip(*(energy_j.tolist() for energy_j in energies_j), strict=True)
        ]

    def search_tables(
        self,
        levels: EnergyLevels,
        harvested_w: Floats,
        power_per_snr_w: Floats,
        uplink_j: Floats,
    ) -> Tables:
        """As `Duplex.search_tables`, from what the links have."""
        raise NotImplementedError

    def check_rows(
        self, levels: WholeLevels, harvest_j: float, price_j: float, least_j: float, most_j: float
    ) -> list[list[int]]:
        """As `Duplex.check_tables`, of one link.

        Args:
            levels: the levels.
            harvest_j, price_j: what a whole slot brings, and what an uplink of a whole slot takes.
            least_j, most_j: what the node gains from charging and uplink together at β_min, and at
                the best β.
        """
        raise NotImplementedError

    def _required_j(self, power_per_snr_w: Array, beta: Array) -> Array:
        return self._link.budget.required_energy_j(power_per_snr_w, self._uplink_s(beta))

    def _uplink_s(self, beta: Array) -> Array:
        # Where nothing is sent, any duration does: 0 would divide by zero.
        return self.xp.where(beta < 1, (1 - beta) * self._link.slot_s, self._one)


beta_rules: Registry[type[BetaRule]] = Registry("beta rule", BetaRule)
