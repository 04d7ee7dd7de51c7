"""Charging and uplink in two bands."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from iout_marl.core.levels import BEYOND_J, EnergyLevels, Tables
from iout_marl.core.limits import DEAREST_J
from iout_marl.core.link import SlotEnergies
from iout_marl.core.reasons import NO_ENERGY, OUT_OF_RANGE, Reason
from iout_marl.core.split import Split
from iout_marl.core.whole_levels import WholeLevels
from iout_marl.parts.base import Context
from iout_marl.parts.duplex.base import Duplex, Integers, duplexes
from iout_marl.physics.arrays import Array
from iout_marl.scenario.fields import Frequency
from iout_marl.scenario.parts import Settings as PartSettings


@duplexes.register("fdd")
class FrequencyDivision(Duplex):
    """Charging and uplink at once, in two bands, both for the whole slot, of any two nodes."""

    class Settings(PartSettings):
        #: Frequency of the sound that charges.
        charging_frequency_khz: Frequency = 40.0
        #: In the middle of the uplink's band.
        uplink_frequency_khz: Frequency = 30.0

    settings: Settings
    num_choices = 2
    name = "FDD"
    uplink_frequency_key = "uplink_frequency_khz"

    @property
    def has_tables(self) -> bool:
        return True

    @property
    def charging_frequency_khz(self) -> float:
        return self.settings.charging_frequency_khz

    @property
    def uplink_frequency_khz(self) -> float:
        return self.settings.uplink_frequency_khz

    def setup(self, world: Context) -> None:
        super().setup(world)
        self._link = world.link
        self._no_beta = world.backend.zeros((world.num_envs, world.scenario.num_auvs))
        self._whole_slot_s = self._no_beta + world.link.slot_s

    def split(self, charging_offset: Array, uplink_offset: Array, stored_j: Array) -> Split:  # noqa: ARG002
        return Split(
            beta=self._no_beta,
            charging_s=self._whole_slot_s,
            uplink_s=self._whole_slot_s,
            required_j=self._link.at(self._link.slot_uplink_j, uplink_offset),
        )

    def sends(self, split: Split, available_j: Array) -> Array:
        return available_j > split.required_j

    def needed_j(self) -> Array:
        link = self._link
        short_j = link.slot_uplink_j - link.harvested_w * link.slot_s
        return self.xp.maximum(short_j, self.xp.zeros_like(short_j))

    def why_silent(self, split: Split, available_j: Array) -> Mapping[Reason, Array]:
        silent = ~self.sends(split, available_j)
        return {OUT_OF_RANGE: split.required_j >= DEAREST_J, NO_ENERGY: silent}

    def energy_never_binds(self, energies: SlotEnergies) -> bool:
        return bool(energies.poorest_j > energies.dearest_j)

    def search_tables(self, levels: EnergyLevels, offset: Any) -> Tables:
        link = self._link
        harvest_j = link.at(link.harvested_w, offset) * link.slot_s
        uplink_j = np.minimum(link.at(link.slot_uplink_j, offset), BEYOND_J)
        charged_j = levels.levels_j + harvest_j
        return Tables(
            charge=levels.level(charged_j),
            deliver=levels.paid(levels.levels_j, uplink_j),
            both=levels.paid(charged_j, uplink_j),
        )

    def check_tables(self, levels: WholeLevels, offsets: Integers) -> list[list[list[int]]]:
        link = self._link
        harvests_j = (link.harvested_w[offsets] * link.slot_s).tolist()
        prices_j = link.slot_uplink_j[offsets].tolist()
        return [_rows(levels, *pair) for pair in zip(harvests_j, prices_j, strict=True)]


def _rows(levels: WholeLevels, harvest_j: float, price_j: float) -> list[list[int]]:
    """Levels after charging, after delivering, and after both."""
    harvest, price = levels.up(harvest_j), levels.down(price_j)
    infinite = len(levels.levels)

    def paid(energy: int) -> int:
        pays = energy + levels.tolerance > price and price_j < DEAREST_J
        return levels.at_least(energy - price) if pays else infinite + 1

    rich = infinite if price_j < DEAREST_J else infinite + 1
    return [
        [*(levels.at_least(level + harvest) for level in levels.levels), infinite],
        [*(paid(level) for level in levels.levels), rich],
        [*(paid(level + harvest) for level in levels.levels), rich],
    ]
