"""The best bound on a scenario that can be had in a given time, verified."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import Any

from iout_marl.bounds.ascent import climb
from iout_marl.bounds.branch_and_bound import search
from iout_marl.bounds.certificate import Certificate, verified_age_sum
from iout_marl.bounds.check_game import is_covered
from iout_marl.bounds.energy import FINE
from iout_marl.bounds.finite_game import FiniteGame
from iout_marl.bounds.lagrangian import fits
from iout_marl.bounds.over_time import in_whole_slots, mean_in_whole_slots, mean_over_time
from iout_marl.bounds.scheduling import least_age_sum
from iout_marl.errors import InputError
from iout_marl.scenario import AnyScenario, Overrides, Scenario, load_scenario
from iout_marl.scenario.parts import Settings, outside_parts
from iout_marl.whole import is_number, short
from iout_marl.words import listed

#: How long a bound is searched for unless told otherwise.
DEFAULT_SECONDS = 60.0
#: What the search's floating-point sums of ages may be too high by; more than enough.
ROUNDING_SLOTS = 0.5
#: Gaps of so many percent are none: the digits of a mean of ages end there.
ROUNDING_PERCENT = 1e-9


@dataclass(frozen=True)
class Bound:
    """Lower bounds on the mean AoI of any policy, in slots.

    Attributes:
        scenario, scenario_hash: what they are for.
        scheduling: the bound by ages alone.
        energy_and_travel: the bound that counts energy and travel in too, that by ages alone
            if no higher one was found; None where there is none.
        validity: for what they hold, why `energy_and_travel` is None if it is, and `stated_by`.
        certificate: of the higher of the two, verified; where ages are taken over time, of the
            scenario in whole slots from which it follows, see `bounds.over_time`.
        stated_by: the parts from outside whose word is taken for it; empty where there are none.
    """

    scenario: str
    scenario_hash: str
    scheduling: float
    energy_and_travel: float | None
    validity: str
    certificate: Certificate
    stated_by: str = ""

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
    """How far a mean AoI lies above another or a bound, in percent of that.

    What is below it by no more than sums of floating-point numbers are rounded is not below.
    """
    gap = 100 * (mean_aoi / of - 1)
    return 0.0 if abs(gap) < ROUNDING_PERCENT else gap


def percent_text(gap: float) -> str:
    """A gap as text: never −0.0, and never 0.0 where a policy lies below a bound."""
    rounded = round(gap, 1) or (-0.1 if gap < 0 else 0.0)
    return f"{rounded:.1f} %"


def bound(
    scenario: AnyScenario,
    best_known: float | None = None,
    seconds: float = DEFAULT_SECONDS,
    *,
    overrides: Overrides = None,
) -> Bound:
    """Bounds on the mean AoI of any policy, verified by `verified_age_sum`.

    Args:
        scenario: whatever `load_scenario` takes.
        best_known: a mean AoI that some policy reaches, in slots: spares looking higher.
        seconds: time to search for: a step that has begun takes up to a second more. The check
            comes on top, and takes about as long again at most.
        overrides: changes of the scenario, as for `load_scenario`.

    Raises:
        InputError: no such scenario, its ages are too large to be added up, or a number is out of
            its range.
    """
    if not (is_number(seconds, 0) or (isinstance(seconds, float) and seconds == math.inf)):
        raise InputError(f"seconds must be 0 or more, not {short(seconds)}")
    if best_known is not None and not (is_number(best_known, 0) and best_known > 0):
        raise InputError(f"best_known must be a mean AoI above 0, not {short(best_known)}")
    scenario = load_scenario(scenario, overrides)
    if scenario.age.is_continuous:
        return _over_time(scenario, best_known, seconds)
    deadline = time.monotonic() + seconds
    node_slots = scenario.num_nodes * scenario.num_slots
    scheduled = least_age_sum(scenario)
    found = [Certificate(scenario.world_hash, scheduled)]
    if is_covered(scenario):
        highest = round(node_slots * (best_known or scenario.age.maximum))
        names_one = scenario.duplex.part.num_choices == 1
        found.append(
            _branch_and_bound(scenario, scheduled, highest, seconds / 4 if names_one else seconds)
        )
        if names_one and (lagrangian := _lagrangian(scenario, deadline - time.monotonic())):
            found.append(lagrangian)
    certificate = _highest_verified(scenario, found)
    energy_and_travel = certificate.age_sum / node_slots if is_covered(scenario) else None
    stated_by = _stated_by(scenario)
    return Bound(
        scenario=scenario.name,
        scenario_hash=scenario.hash,
        scheduling=scheduled / node_slots,
        energy_and_travel=energy_and_travel,
        validity="; ".join(filter(None, [_validity(scenario), stated_by])),
        certificate=certificate,
        stated_by=stated_by,
    )


def _over_time(scenario: Scenario, best_known: float | None, seconds: float) -> Bound:
    """The bounds of ages that are taken over time."""
    known = None if best_known is None else mean_in_whole_slots(scenario, best_known)
    found = bound(in_whole_slots(scenario), known and max(known, 1.0), seconds)
    higher = found.energy_and_travel
    return replace(
        found,
        scenario=scenario.name,
        scenario_hash=scenario.hash,
        scheduling=mean_over_time(scenario, found.scheduling),
        energy_and_travel=None if higher is None else mean_over_time(scenario, higher),
    )


def _branch_and_bound(scenario: Scenario, proven: int, highest: int, seconds: float) -> Certificate:
    """The branch-and-bound bound's certificate."""
    deadline = time.monotonic() + seconds
    field = FiniteGame.from_scenario(scenario)
    age_sum = search(field, proven, highest, deadline - time.monotonic())
    return Certificate(scenario.world_hash, age_sum, tuple(field.levels_j[:-1].tolist()))


def _lagrangian(scenario: Scenario, seconds: float) -> Certificate | None:
    """The Lagrangian bound's certificate, where memory and time are enough for one."""
    deadline = time.monotonic() + seconds
    field = FiniteGame.from_scenario(scenario, FINE)
    climbed = climb(field, deadline - time.monotonic()) if fits(field) else None
    if climbed is None:
        return None
    # Sums of ages are whole numbers; the search's own are rounded.
    age_sum = max(math.ceil(climbed.age_sum - ROUNDING_SLOTS), 0)
    levels_j = tuple(climbed.field.levels_j[:-1].tolist())
    return Certificate(scenario.world_hash, age_sum, levels_j, climbed.prices, climbed.oldest)


def _highest_verified(scenario: Scenario, found: list[Certificate]) -> Certificate:
    """The certificate of the highest claim that the check confirms; of like ones the simplest.

    Where the search's rounding has led it astray, or the check would take too much memory, the
    next lower claim is made; the scheduling bound, the first of them, is always confirmed.
    """
    first, *others = sorted(found, key=lambda certificate: -certificate.age_sum)
    try:
        verified_age_sum(scenario, first)
    except InputError:
        if not others:
            raise
        return _highest_verified(scenario, others)
    return first


def _validity(scenario: Scenario) -> str:
    redraws = scenario.nodes.part.redraws
    if redraws != "never":
        when = f"every {redraws}"
        return (
            f"nodes are drawn for {when}: the scheduling bound holds for every layout, "
            "one by energy and travel would hold for fixed nodes only"
        )
    if scenario.num_auvs > 1:
        return "the scheduling bound holds; the one by energy and travel is for one AUV"
    if scenario.hearing.part.polls:
        return (
            "the scheduling bound holds; the one by energy and travel is for AUVs that hear the "
            "node that they have chosen and no other"
        )
    if not scenario.duplex.part.has_tables:
        return (
            "the scheduling bound holds; for one by energy and travel the duplex part "
            f"{scenario.duplex.kind!r} would have to state what a slot does to stored energy"
        )
    if adds := scenario.storage.part.what_it_adds(scenario):
        return (
            "the scheduling bound holds; for one by energy and travel stores would have to do "
            f"nothing but take possibilities away: {adds}"
        )
    if adds := scenario.vehicle.part.what_it_adds(scenario):
        return (
            "the scheduling bound holds; one by energy and travel would hold for vehicles without "
            f"end of energy, and for limits that only remove possibilities: {adds}"
        )
    if adds := scenario.current.part.what_it_adds(scenario):
        return (
            "the scheduling bound holds; one by energy and travel would hold for still water, and "
            f"for currents that only remove possibilities: {adds}"
        )
    if adds := scenario.channel.part.fading.what_it_adds(scenario):
        return (
            "the scheduling bound holds; one by energy and travel would hold for levels that never "
            f"rise above what the distance makes them: {adds}"
        )
    return "both bounds hold for every policy"


def _stated_by(scenario: Scenario) -> str:
    """'as stated by part …', of the parts from outside that the bounds take at their word.

    How many uplinks can arrive in a slot, the access and the hearing part say; where nodes lie,
    where an AUV can go and what a slot does to stored energy only matters to the bound by energy
    and travel.
    """
    relied_on: list[Settings] = [scenario.channel.part.access.settings, scenario.hearing]
    if is_covered(scenario):
        relied_on += [scenario.duplex, scenario.storage, scenario.vehicle, scenario.current]
        relied_on += [scenario.channel.part.fading.settings]
        relied_on += [scenario.auvs.motion, scenario.nodes]
    outside = {entry: None for settings in relied_on for entry in outside_parts(settings)}
    parts = [f"part {entry.kind!r} ({entry.role})" for entry in outside]
    return f"as stated by {listed(parts)}" if parts else ""
