"""A rule for β that counts what a node has stored."""

from __future__ import annotations

from typing import Any

import numpy as np

from iout_marl import physics
from iout_marl.core.levels import EnergyLevels, Tables
from iout_marl.core.limits import unheard_on_numpy
from iout_marl.core.link import SlotEnergies
from iout_marl.core.split import Split
from iout_marl.core.whole_levels import WholeLevels
from iout_marl.parts.base import Context
from iout_marl.parts.beta_rule.base import BetaRule, Floats, beta_rules
from iout_marl.physics.arrays import Array


@beta_rules.register("stored")
class StoredRule(BetaRule):
    """The smallest β of {0} ∪ [β_min, β_max] for which stored and harvested energy pay, else 1."""

    has_tables = True

    def setup(self, world: Context) -> None:
        super().setup(world)
        # What overflows is out of reach: no β pays it, or nothing is sent.
        self._by_store = unheard_on_numpy(self.xp, self._split)

    def split(self, charging_offset: Array, uplink_offset: Array, stored_j: Array) -> Split:
        return self._by_store(charging_offset, uplink_offset, stored_j)

    def _split(self, charging_offset: Array, uplink_offset: Array, stored_j: Array) -> Split:
        xp, link = self.xp, self._link
        power_per_snr_w = link.at(link.power_per_snr_w, uplink_offset)
        harvested_w = link.at(link.harvested_w, charging_offset)
        beta = physics.smallest_beta.unchecked(
            stored_j, harvested_w, power_per_snr_w, *self.interval
        )
        beta = xp.where(xp.isnan(beta), self._one, beta)
        only_sends = stored_j > link.at(link.slot_uplink_j, uplink_offset)
        beta = xp.where(only_sends, self._zero, beta)
        return Split(
            beta=beta,
            charging_s=beta * link.slot_s,
            uplink_s=self._uplink_s(beta),
            required_j=self._required_j(power_per_snr_w, beta),
        )

    def energy_never_binds(self, energies: SlotEnergies, bounds: Any) -> bool:
        link, offsets = energies.link, energies.offsets
        uplink_s = (1 - bounds.beta_min) * link.slot_s
        required_j = link.budget.required_energy_j(link.power_per_snr_w[offsets], uplink_s)
        return bool(energies.poorest_j * bounds.beta_min > required_j.max())

    def search_tables(
        self,
        levels: EnergyLevels,
        harvested_w: Floats,
        power_per_snr_w: Floats,
        uplink_j: Floats,
    ) -> Tables:
        """TDD with the smallest β that pays.

        Of the energies up to a level some send without charging, some charge for β_min, some
        for just what they need, which leaves nothing, and some can but charge. A node leaves off
        with the most that any of them could.
        """
        duplex = self._bounds
        levels_j, tolerance_j = levels.levels_j, levels.tolerance_j
        harvest_j = harvested_w * self._link.slot_s
        finite_j = np.where(np.isinf(levels_j), np.finfo(np.float64).max / 4, levels_j)
        pays = ~np.isnan(self._smallest_beta(finite_j + tolerance_j, harvested_w, power_per_snr_w))
        sends_j = levels_j + tolerance_j > uplink_j
        # Charging for β_min comes first only while the store alone does not pay.
        poor_j = np.minimum(levels_j, uplink_j)
        least_s = (1 - duplex.beta_min) * self._link.slot_s
        least_j = self._link.budget.required_energy_j(power_per_snr_w, least_s)
        surplus_j = poor_j + duplex.beta_min * harvest_j - least_j
        left_j = np.maximum(np.where(sends_j, levels_j - uplink_j, 0.0), np.maximum(surplus_j, 0.0))
        deliver = np.where(pays | sends_j, levels.level(left_j), -1)
        # A level holds an energy that cannot deliver if the level below it, or 0, cannot.
        below_j = levels.below_j
        below_pays = ~np.isnan(self._smallest_beta(below_j, harvested_w, power_per_snr_w))
        can_fail = ~below_pays & (below_j <= uplink_j)
        charge = np.where(can_fail, levels.level(levels_j + harvest_j), -1)
        return levels.with_disposal(deliver, charge)

    def _smallest_beta(
        self, stored_j: Floats, harvested_w: Floats, power_per_snr_w: Floats
    ) -> Floats:
        return np.asarray(
            physics.smallest_beta(stored_j, harvested_w, power_per_snr_w, *self.interval)
        )

    def check_rows(
        self, levels: WholeLevels, harvest_j: float, price_j: float, least_j: float, most_j: float
    ) -> list[list[int]]:
        harvest, price, tolerance = levels.up(harvest_j), levels.down(price_j), levels.tolerance
        least, most = levels.up(least_j), levels.up(most_j)
        # Only a node whose store alone does not pay charges for β_min first.
        poorest = levels.up(price_j)
        deliver, charge = [], []
        for below, level in levels.rungs:
            left = [level - price] if level + tolerance > price else []
            if level + most + 2 * tolerance >= 0:
                left.append(max(min(level, poorest) + least, 0))
            deliver.append(levels.at_least(max(left)) if left else -1)
            can_fail = below - tolerance <= price and below + most <= 2 * tolerance
            charge.append(levels.at_least(level + harvest) if can_fail else -1)
        return [levels.best_so_far(charge), levels.best_so_far(deliver)]
