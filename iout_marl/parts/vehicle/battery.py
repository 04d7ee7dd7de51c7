"""Vehicles with a battery, that may be recharged in docks."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Self

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from iout_marl import physics
from iout_marl.core.grid import Grid
from iout_marl.core.pace import Pace
from iout_marl.parts.vehicle.base import Cells, MaxSpeed, Vehicle, vehicles
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import (
    Cell,
    Efficiency,
    Fraction,
    NonNegative,
    Plausible,
    Positive,
    invalid,
)
from iout_marl.scenario.parts import Settings as PartSettings
from iout_marl.words import listed

#: More docks than any fleet needs.
MAX_DOCKS = 1_000


@vehicles.register("battery")
class Battery(Vehicle):
    """A battery that moves the vehicle, feeds it all the time, and charges nodes.

    What it cannot pay for in full is left: it stays where it is, or charges nobody. A vehicle that
    cannot pay for its hotel load in a slot is empty: it does nothing until it has been recharged,
    which it is only where it lies in a dock.
    """

    class Settings(PartSettings):
        #: What a full battery holds.
        capacity_j: Annotated[Positive, Plausible(1, 1e12, "J")]
        #: Share of it that every AUV begins an episode with.
        initial_share: Fraction = 1.0
        #: Area that the drag coefficient refers to, that of the hull's surface say.
        drag_area_m2: Annotated[Positive, Plausible(1e-4, 1e4, "m²")]
        #: Coefficient of the drag, for that area.
        drag_coefficient: Annotated[Positive, Plausible(1e-5, 10)]
        #: Share of the propulsion's electric power that overcomes drag.
        propulsion_efficiency: Efficiency
        #: Power that an AUV draws all the time, beside propulsion and charging.
        hotel_w: Annotated[NonNegative, Plausible(0, 1e6, "W")]
        #: Cells in which an AUV is recharged.
        docks: Annotated[tuple[Cell, ...], Field(max_length=MAX_DOCKS, strict=False)] = ()
        #: Power with which a dock recharges each AUV in it, above the hotel load.
        dock_power_w: Annotated[NonNegative, Plausible(0, 1e7, "W")] = 0.0
        #: Highest speed through the water; null for no limit. In a current, moves that need more
        #: are impossible.
        max_speed_m_per_s: MaxSpeed = None

        hash_defaults: ClassVar[dict[str, Any]] = {"max_speed_m_per_s": None}

        @model_validator(mode="after")
        def _docks_recharge(self) -> Self:
            if self.docks and self.dock_power_w <= self.hotel_w:
                raise invalid(
                    ("dock_power_w",),
                    f"must be above vehicle.hotel_w, {self.hotel_w:g} W: else no dock recharges",
                    beside=("vehicle", "hotel_w"),
                )
            return self

    settings: Settings

    @property
    def capacity_j(self) -> float:  # type: ignore[override]
        return self.settings.capacity_j

    @property
    def initial_j(self) -> float:  # type: ignore[override]
        return self.settings.initial_share * self.settings.capacity_j

    @property
    def hotel_w(self) -> float:  # type: ignore[override]
        return self.settings.hotel_w

    @property
    def docks(self) -> Cells:  # type: ignore[override]
        return self.settings.docks

    @property
    def dock_power_w(self) -> float:  # type: ignore[override]
        return self.settings.dock_power_w

    @property
    def max_speed_m_per_s(self) -> float | None:  # type: ignore[override]
        return self.settings.max_speed_m_per_s

    def check(self, scenario: Scenario) -> None:
        super().check(scenario)
        for i, cell in enumerate(self.docks):
            scenario.check_cell(("vehicle", "docks", i), cell)
        self._check_depths(scenario)
        slot_s, grid = scenario.slot_s, Grid.from_scenario(scenario)
        steps = np.array(scenario.auvs.motion.part.steps) * (np.array(grid.shape) > 1)
        speed = grid.metres(steps) / (Pace.from_scenario(scenario).slots * slot_s)
        hotel_j = self.hotel_w * slot_s
        move_j = slot_s * self.propulsion_power_w(speed[speed > 0]).min(initial=np.inf)
        if not np.isfinite(move_j):
            move_j = 0.0
        for key, energy_j in (("capacity_j", self.capacity_j), ("initial_share", self.initial_j)):
            if energy_j < hotel_j + move_j or energy_j == 0:
                raise invalid(
                    ("vehicle", key),
                    f"the battery does not last one slot: it has {energy_j:.3g} J, and a slot of "
                    f"{slot_s:g} s takes {hotel_j:.3g} J of hotel load and {move_j:.3g} J at least "
                    "for a move",
                )

    def _check_depths(self, scenario: Scenario) -> None:
        """Refuse docks to which no direction leads from any start, as from another depth."""
        auvs = scenario.auvs
        still = np.flatnonzero(~np.array(auvs.motion.part.axes_moved))
        if not (self.docks and len(still)):
            return
        starts = scenario.starts()
        for i, cell in enumerate(self.docks):
            if not (starts[:, still] + 1 == np.array(cell)[still]).all(axis=1).any():
                raise invalid(
                    ("vehicle", "docks", i),
                    f"no AUV can come to cell {list(cell)}: with auvs.motion {auvs.motion.kind!r} "
                    f"all keep the {listed(['xyz'[axis] for axis in still])} of their starts",
                    beside=("auvs", "motion"),
                )

    def what_it_adds(self, scenario: Scenario) -> str:
        if scenario.auvs.motion.part.can_rest:
            return ""
        return (
            "an AUV that cannot pay for a move stays where it is, which motion "
            f"{scenario.auvs.motion.kind!r} does not let it do otherwise"
        )

    def propulsion_power_w(self, speed_m_per_s: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        power_w: npt.NDArray[np.float64] = physics.propulsion_power_w(
            speed_m_per_s,
            self.settings.drag_area_m2,
            self.settings.drag_coefficient,
            self.settings.propulsion_efficiency,
        )
        return power_w
