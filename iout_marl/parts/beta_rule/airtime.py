"""A rule for β that leaves an uplink the time that it takes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from iout_marl.core.levels import EnergyLevels, Tables
from iout_marl.core.limits import DEAREST_J
from iout_marl.core.link import SlotEnergies
from iout_marl.core.reasons import OUT_OF_RANGE, Reason
from iout_marl.core.split import Split
from iout_marl.core.whole_levels import WholeLevels
from iout_marl.parts.base import Context
from iout_marl.parts.beta_rule.base import BetaRule, Integers, beta_rules
from iout_marl.physics.arrays import Array
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import invalid


@beta_rules.register("airtime")
class AirtimeRule(BetaRule):
    """β leaves a modem the time for its packet: 1 − (L/R + 2 d/c)/τ, at most β_max.

    It charges for that long and sends if stored and harvested energy pay, and else only charges
    (β = 1); so too where the packet would take more than (1 − β_min) τ.
    """

    has_tables = True
    uplinks_fill_their_time = False

    def check(self, scenario: Scenario) -> None:
        if scenario.uplink.part.fills_its_time:
            raise invalid(
                ("duplex", "beta_rule"),
                f"'airtime' is for uplinks that take a time of their own, such as uplink.kind: "
                f"modem, not for {scenario.uplink.kind!r}",
                beside=("uplink",),
            )

    @staticmethod
    def longest_uplink(bounds: Any) -> float:
        return 1.0 - float(bounds.beta_min)

    def setup(self, world: Context) -> None:
        super().setup(world)
        xp, link = self.xp, self._link
        share = self._one - link.least_uplink_s / link.slot_s
        most = xp.zeros_like(share) + self._bounds.beta_max
        least = xp.zeros_like(share) + self._bounds.beta_min
        # What takes longer is out of reach anyway.
        self._beta = xp.maximum(xp.minimum(share, most), least)

    def split(self, charging_offset: Array, uplink_offset: Array, stored_j: Array) -> Split:
        xp, link = self.xp, self._link
        beta = link.at(self._beta, uplink_offset)
        required_j = link.at(link.slot_uplink_j, uplink_offset)
        charged_j = link.at(link.harvested_w, charging_offset) * (beta * link.slot_s)
        pays = stored_j + charged_j > required_j
        beta = xp.where(pays, beta, self._one)
        return Split(
            beta=beta,
            charging_s=beta * link.slot_s,
            uplink_s=self._uplink_s(beta),
            required_j=required_j,
        )

    def why_silent(self, split: Split) -> Mapping[Reason, Array]:
        return {OUT_OF_RANGE: split.required_j >= DEAREST_J}

    def energy_never_binds(self, energies: SlotEnergies, bounds: Any) -> bool:
        return bool(energies.poorest_j * bounds.beta_min > energies.dearest_j)

    def search_links(self, levels: EnergyLevels, offset: Any) -> Tables:
        link = self._link
        harvested_w, uplink_j = (
            link.at(table, offset) for table in (link.harvested_w, link.slot_uplink_j)
        )
        before_j = harvested_w * (link.at(self._beta, offset) * link.slot_s)
        paid = levels.paid(levels.levels_j + before_j, uplink_j)
        deliver = np.where(paid < len(levels.levels_j), paid, -1)
        # A level holds an energy that cannot pay if the level below it, or 0, cannot.
        can_fail = (levels.below_j + before_j <= uplink_j) | (uplink_j >= DEAREST_J)
        charged = levels.level(levels.levels_j + harvested_w * link.slot_s)
        return levels.with_disposal(deliver, np.where(can_fail, charged, -1))

    def check_links(self, levels: WholeLevels, offsets: Integers) -> list[list[list[int]]]:
        link, bounds = self._link, self._bounds
        free = 1 - link.least_uplink_s[offsets] / link.slot_s
        beta = np.clip(free, bounds.beta_min, bounds.beta_max)
        harvest_j = link.harvested_w[offsets] * link.slot_s
        rows = (harvest_j, harvest_j * beta, link.slot_uplink_j[offsets])
        return [_rows(levels, *row) for row in zip(*(each.tolist() for each in rows), strict=True)]


def _rows(
    levels: WholeLevels, harvest_j: float, before_j: float, price_j: float
) -> list[list[int]]:
    """Levels after naming a node in vain, and after naming it so that it delivers."""
    harvest, before = levels.up(harvest_j), levels.up(before_j)
    price, tolerance = levels.down(price_j), levels.tolerance
    reaches = price_j < DEAREST_J
    deliver, charge = [], []
    for below, level in levels.rungs:
        pays = reaches and level + before + tolerance > price
        deliver.append(levels.at_least(max(level + before - price, 0)) if pays else -1)
        can_fail = not reaches or below - tolerance + before <= price
        charge.append(levels.at_least(level + harvest) if can_fail else -1)
    return [levels.best_so_far(charge), levels.best_so_far(deliver)]
