"""Stores that are soon full, leak, and feed a node that draws power while it waits."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import model_validator

from iout_marl.parts.base import Context
from iout_marl.parts.storage.base import Rest, Storage, storages
from iout_marl.physics.arrays import Array
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import NonNegative, Plausible, Positive, invalid
from iout_marl.scenario.parts import Settings as PartSettings


@storages.register("capacitor")
class Capacitor(Storage):
    """A store of limited capacity that leaks, in a node that draws power while it waits.

    A node that has nothing left to pay its idle draw with sleeps, and sends nothing, until it is
    charged.
    """

    class Settings(PartSettings):
        #: The most that a store holds: what is harvested beyond it is spilled.
        capacity_j: Annotated[Positive, Plausible(1e-9, 1e9, "J")]
        #: What every store holds when an episode begins.
        initial_j: Annotated[NonNegative, Plausible(0, 1e9, "J")] = 0.0
        #: Power that a store loses as long as it holds any energy.
        leakage_w: Annotated[NonNegative, Plausible(0, 1e4, "W")] = 0.0
        #: Power that a node draws all the time, beside what its uplinks take.
        idle_w: Annotated[NonNegative, Plausible(0, 1e4, "W")] = 0.0

        @model_validator(mode="after")
        def _initial_within_capacity(self) -> Self:
            if self.initial_j > self.capacity_j:
                raise invalid(
                    ("initial_j",),
                    f"must not exceed storage.capacity_j, {self.capacity_j:g}",
                    beside=("storage", "capacity_j"),
                )
            return self

    settings: Settings

    @property
    def initial_j(self) -> float:  # type: ignore[override]
        return self.settings.initial_j

    @property
    def capacity_j(self) -> float:  # type: ignore[override]
        return self.settings.capacity_j

    @property
    def drain_w(self) -> float:  # type: ignore[override]
        return self.settings.leakage_w + self.settings.idle_w

    def what_it_adds(self, scenario: Scenario) -> str:
        if self.initial_j:
            return "storage.initial_j gives nodes energy that they have not harvested"
        if scenario.duplex.part.splits_slot:
            return "a node whose store is full takes in energy where it would otherwise send"
        return ""

    def setup(self, world: Context) -> None:
        super().setup(world)
        floats, settings = world.backend.floats, self.settings
        self._capacity_j = floats(settings.capacity_j)
        self._drain_j = floats(self.drain_w * world.link.slot_s)
        # Where less is left than both ask for, each gets its share.
        self._leaked_share = floats(settings.leakage_w / (self.drain_w or 1.0))

    def filled(self, energy_j: Array) -> Array:
        return self.xp.minimum(energy_j, self._capacity_j)

    def rest(self, energy_j: Array) -> Rest:
        lost_j = self.xp.minimum(energy_j, self._drain_j)
        leaked_j = lost_j * self._leaked_share
        return Rest(energy_j - lost_j, leaked_j, lost_j - leaked_j)

    def sleeps(self, available_j: Array) -> Array:
        return available_j <= self._zero if self.settings.idle_w else super().sleeps(available_j)
