"""A rule for β that leaves an uplink the time that it takes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from iout_marl.core.limits import DEAREST_J
from iout_marl.core.link import SlotEnergies
from iout_marl.core.reasons import OUT_OF_RANGE, Reason
from iout_marl.core.split import Split
from iout_marl.parts.base import Context
from iout_marl.parts.beta_rule.base import BetaRule, beta_rules
from iout_marl.physics.arrays import Array
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import invalid


@beta_rules.register("airtime")
class AirtimeRule(BetaRule):
    """β leaves a modem the time for its packet: 1 − (L/R + 2 d/c)/τ, at most β_max.

    It charges for that long and sends if stored and harvested energy pay, and else only charges
    (β = 1); so too where the packet would take more than (1 − β_min) τ.
    """

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
