"""The best bound on a scenario that can be had in a given time, verified."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

from iout_marl.bounds.ascent import climb
from iout_marl.bounds.certificate import Certificate, verified_age_sum
from iout_marl.bounds.energy import FINE
from iout_marl.bounds.field import Field, is_covered
from iout_marl.bounds.opening import search
from iout_marl.bounds.scheduling import least_age_sum
from iout_marl.bounds.sharing import fits, oldest_age
from iout_marl.scenario import RandomNodes, Scenario, Tdd

#: How long a bound is searched for unless told otherwise.
USUAL_SECONDS = 60.0
#: What the search's floating-point sums of ages may be too high by; more than enough.
ROUNDING_SLOTS = 0.5


@dataclass(frozen=True)
class Bound:
    """Lower bounds on the mean AoI of any policy, in slots.

    Attributes:
        scenario, scenario_hash: what they are for.
        scheduling: the bound by ages alone.
        energy_and_travel: the bound that counts energy and travel in too, that by ages alone
            if no higher one was found; None where there is none.
        validity: for what they hold, and why `energy_and_travel` is None if it is.
        certificate: of the higher of the two, verified.
    """

    scenario: str
    scenario_hash: str
    scheduling: float
    energy_and_travel: float | None
    validity: str
    certificate: Certificate

    @property
    def best(self) -> float:
        """The higher of the two."""
        return max(self.scheduling, self.energy_and_travel or 0.0)

    def gap_percent(self, mean_aoi: float) -> float:
        """How far a mean AoI lies above the best bound, in percent of the bound."""
        return gap_percent(mean_aoi, self.best)

    def to_json(self) -> dict[str, Any]:
        """The bounds as JSON has them."""
        return {
            "scenario": self.scenario,
            "scenario_hash": self.scenario_hash,
            "scheduling": self.scheduling,
            "energy_and_travel": self.energy_and_travel,
            "best": self.best,
            "validity": self.validity,
            "certificate": self.certificate.to_json(),
        }


def rounded_down(value: float, digits: int) -> str:
    """A bound as text, which is never more than it is."""
    # A decimal number of few digits is itself, and not what its last bit makes of it.
    return f"{math.floor(round(value * 10**digits, 4)) / 10**digits:.{digits}f}"


def gap_percent(mean_aoi: float, of: float) -> float:
    """How far a mean AoI lies above another or a bound, in percent of that."""
    return 100 * (mean_aoi / of - 1)


def bound(
    scenario: Scenario, best_known: float | None = None, seconds: float = USUAL_SECONDS
) -> Bound:
    """Bounds on the mean AoI of any policy, verified by `verified_age_sum`.

    Args:
        scenario: the scenario.
        best_known: a mean AoI that some policy reaches, in slots: spares looking higher.
        seconds: time to search for, about: a step that has begun is finished, and the check
            comes on top.
    """
    node_slots = scenario.num_nodes * scenario.num_slots
    scheduled = least_age_sum(scenario)
    certificate = Certificate(scenario.world_hash, scheduled)
    energy_and_travel = None
    if is_covered(scenario):
        highest = round(node_slots * (best_known or scenario.age.maximum))
        is_tdd = isinstance(scenario.duplex, Tdd)
        deadline = time.monotonic() + seconds
        certificate = _opening(scenario, certificate, highest, seconds / 4 if is_tdd else seconds)
        if is_tdd and time.monotonic() < deadline:
            certificate = _sharing(scenario, certificate, deadline - time.monotonic())
        energy_and_travel = certificate.age_sum / node_slots
    verified_age_sum(scenario, certificate)
    return Bound(
        scenario=scenario.name,
        scenario_hash=scenario.hash,
        scheduling=scheduled / node_slots,
        energy_and_travel=energy_and_travel,
        validity=_validity(scenario),
        certificate=certificate,
    )


def _opening(scenario: Scenario, known: Certificate, highest: int, seconds: float) -> Certificate:
    """The opening bound's certificate, if it is higher than what is known."""
    field = Field.of(scenario)
    found = search(field, known.age_sum, highest, seconds)
    if found <= known.age_sum:
        return known
    return Certificate(scenario.world_hash, found, tuple(field.levels_j[:-1].tolist()))


def _sharing(scenario: Scenario, known: Certificate, seconds: float) -> Certificate:
    """The sharing bound's certificate, if it is higher than what is known."""
    field = Field.of(scenario, FINE)
    if not fits(field):
        return known
    found, prices = climb(field, seconds)
    # Sums of ages are whole numbers; the search's own are rounded.
    age_sum = math.ceil(found - ROUNDING_SLOTS)
    if age_sum <= known.age_sum:
        return known
    levels_j = tuple(field.levels_j[:-1].tolist())
    return Certificate(scenario.world_hash, age_sum, levels_j, prices, oldest_age(field))


def _validity(scenario: Scenario) -> str:
    if isinstance(scenario.nodes, RandomNodes):
        when = "every episode" if scenario.nodes.redraw == "episode" else "every run"
        return (
            f"nodes are drawn for {when}: the scheduling bound holds for every layout, "
            "one by energy and travel would hold for fixed nodes only"
        )
    if scenario.num_auvs > 1:
        return "the scheduling bound holds; the one by energy and travel is for one AUV"
    return "both bounds hold for every policy"
