"""Charging and uplink in one band, one after the other."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Self

from pydantic import Field, model_validator

from iout_marl.core.levels import EnergyLevels, Tables
from iout_marl.core.link import SlotEnergies
from iout_marl.core.reasons import ONLY_CHARGED, Reason
from iout_marl.core.split import Split
from iout_marl.core.whole_levels import WholeLevels
from iout_marl.parts.base import Context, at_work
from iout_marl.parts.beta_rule import BetaRule
from iout_marl.parts.duplex.base import Duplex, Integers, duplexes
from iout_marl.physics.arrays import Array
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import Fraction, Frequency, invalid
from iout_marl.scenario.parts import PartOf
from iout_marl.scenario.parts import Settings as PartSettings


@duplexes.register("tdd")
class TimeDivision(Duplex):
    """One band and one node a slot: charging for βτ, uplink for (1 − β)τ."""

    class Settings(PartSettings):
        #: Frequency of the sound that charges, and in the middle of the uplink's band.
        frequency_khz: Frequency = 40.0
        #: How β follows from the energy balance.
        beta_rule: Annotated[PartSettings, PartOf("beta rule", is_word=True)] = Field(
            "paper", validate_default=True
        )
        #: β_min: least share of a slot for charging, where there is any.
        beta_min: Fraction = 0.1
        #: β_max: largest share of a slot for charging in which something is sent.
        beta_max: Fraction = 0.9
        #: Whether the AUVs charge at the same time; if not, one that charges disturbs those that
        #: listen (`channel.access: interference`).
        synchronised: bool = False

        hash_defaults: ClassVar[dict[str, Any]] = {"synchronised": False}

        @model_validator(mode="after")
        def _bounds_in_order(self) -> Self:
            if not self.beta_min < self.beta_max < 1:
                raise invalid(
                    ("beta_min",),
                    f"the bounds must satisfy beta_min < beta_max < 1, "
                    f"not {self.beta_min:g} and {self.beta_max:g}",
                )
            return self

    settings: Settings
    num_choices = 1
    splits_slot = True
    name = "TDD"
    uplink_frequency_key = "frequency_khz"

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings)
        self.rule: BetaRule = settings.beta_rule.part

    @property
    def has_tables(self) -> bool:
        return self.rule.has_tables

    @property
    def uplinks_fill_their_time(self) -> bool:
        return self.rule.uplinks_fill_their_time

    @property
    def longest_uplink(self) -> float:
        return self.rule.longest_uplink(self.settings)

    @property
    def charging_frequency_khz(self) -> float:
        return self.settings.frequency_khz

    @property
    def uplink_frequency_khz(self) -> float:
        return self.settings.frequency_khz

    @property
    def charging_disturbs_uplinks(self) -> bool:
        return not self.settings.synchronised

    def check(self, scenario: Scenario) -> None:
        self.rule.check(scenario)

    def setup(self, world: Context) -> None:
        super().setup(world)
        self._link = world.link
        self.rule = at_work(self.settings.beta_rule, world)

    def split(self, charging_offset: Array, uplink_offset: Array, stored_j: Array) -> Split:
        return self.rule.split(charging_offset, uplink_offset, stored_j)

    def sends(self, split: Split, available_j: Array) -> Array:  # noqa: ARG002
        # The rule for β has seen to it that the uplink is paid wherever there is one.
        return split.beta < 1

    def why_silent(self, split: Split, available_j: Array) -> Mapping[Reason, Array]:
        return {**self.rule.why_silent(split), ONLY_CHARGED: ~self.sends(split, available_j)}

    def energy_never_binds(self, energies: SlotEnergies) -> bool:
        return self.rule.energy_never_binds(energies, self.settings)

    def search_tables(self, levels: EnergyLevels, offset: Any) -> Tables:
        return self.rule.search_links(levels, offset)

    def check_tables(self, levels: WholeLevels, offsets: Integers) -> list[list[list[int]]]:
        return self.rule.check_links(levels, offsets)
