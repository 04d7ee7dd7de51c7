"""The paper's rule for β."""

from __future__ import annotations

from typing import Any

import numpy as np

from iout_marl import physics
from iout_marl.core.levels import EnergyLevels, Tables
from iout_marl.core.limits import DEAREST_J, bounded, unheard
from iout_marl.core.link import SlotEnergies
from iout_marl.core.split import Split
from iout_marl.core.whole_levels import WholeLevels
from iout_marl.parts.base import Context
from iout_marl.parts.beta_rule.base import BetaRule, Floats, beta_rules
from iout_marl.physics.arrays import Array


@beta_rules.register("paper")
class PaperRule(BetaRule):
    """β is the root in [β_min, β_max] at which E_harv(β) rises to E_req(β).

    It depends on the distance alone. Where there is no root, β is 0 if the stored energy pays the
    uplink, else 1.
    """

    has_tables = True

    @unheard
    def setup(self, world: Context) -> None:
        super().setup(world)
        xp, link = self.xp, world.link
        root = physics.beta_star.unchecked(link.harvested_w, link.power_per_snr_w, *self.interval)
        self._has_root = ~xp.isnan(root)
        #: β and the energy of its uplink by offset; 1, charging only, without a root.
        self._beta_star = xp.where(self._has_root, root, self._one)
        star_uplink_j = self._required_j(link.power_per_snr_w, self._beta_star)
        self._star_uplink_j = bounded(star_uplink_j, 0.0, DEAREST_J)

    def split(self, charging_offset: Array, uplink_offset: Array, stored_j: Array) -> Split:
        xp, link = self.xp, self._link
        slot_uplink_j = link.at(link.slot_uplink_j, uplink_offset)
        only_sends = (stored_j > slot_uplink_j) & ~link.at(self._has_root, charging_offset)
        beta = xp.where(only_sends, self._zero, link.at(self._beta_star, charging_offset))
        star_uplink_j = link.at(self._star_uplink_j, uplink_offset)
        return Split(
            beta=beta,
            charging_s=beta * link.slot_s,
            uplink_s=self._uplink_s(beta),
            required_j=xp.where(only_sends, slot_uplink_j, star_uplink_j),
        )

    def energy_never_binds(self, energies: SlotEnergies, bounds: Any) -> bool:  # noqa: ARG002
        # A slot is left to one of the two where the least β harvests more than enough: the
        # harvest of one slot must pay for an uplink in all of them.
        return bool(energies.poorest_j > energies.dearest_j * energies.num_slots)

    def search_tables(
        self,
        levels: EnergyLevels,
        harvested_w: Floats,
        power_per_snr_w: Floats,
        uplink_j: Floats,
    ) -> Tables:
        # Where there is a root, a slot brings what its uplink takes.
        levels_j = levels.levels_j
        beta = physics.beta_star(harvested_w, power_per_snr_w, *self.interval)
        harvest_j = harvested_w * self._link.slot_s
        has_root = np.broadcast_to(~np.isnan(beta), (*beta.shape[:-1], len(levels_j)))
        stays = np.broadcast_to(np.arange(len(levels_j)), has_root.shape)
        paid = levels.paid(levels_j, uplink_j)
        deliver = np.where(has_root, stays, np.where(paid < len(levels_j), paid, -1))
        below_j = levels.below_j
        can_fail = ~has_root & (below_j <= uplink_j)
        charge = np.where(can_fail, levels.level(levels_j + harvest_j), -1)
        return levels.with_disposal(deliver, charge)

    def check_rows(
        self, levels: WholeLevels, harvest_j: float, price_j: float, least_j: float, most_j: float
    ) -> list[list[int]]:
        # The root where the gain rises through 0, whatever is stored.
        harvest, price, tolerance = levels.up(harvest_j), levels.down(price_j), levels.tolerance
        least, most = levels.up(least_j), levels.up(most_j)
        may_have_root = least <= tolerance and most >= -tolerance
        has_root = may_have_root and least < -tolerance and most > 2 * tolerance
        deliver, charge = [], []
        for below, level in levels.rungs:
            left = [level] if may_have_root else []
            if level + tolerance > price:
                left.append(level - price)
            deliver.append(levels.at_least(max(left)) if left else -1)
            can_fail = not has_root and below - tolerance <= price
            charge.append(levels.at_least(level + harvest) if can_fail else -1)
        return [levels.best_so_far(charge), levels.best_so_far(deliver)]
