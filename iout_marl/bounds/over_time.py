"""Bounds on ages that are taken over time, by those on ages in whole slots.

With `age.sampling: packet_start` a packet that arrives leaves the age x that it took, in slots; a
slot adds ∫ min(A_max, c + s) ds, 0 ≤ s ≤ 1, to the sum of ages that it begins with at c. Let the
same packets arrive with `slot_end`, and let the ages then be e at the start of a slot. In the first
slot c = e; later c ≥ e − 1 + x, x now of the shortest packet, for one that arrives makes e = 1, and
both grow and stop alike. The integral grows with c, and e ≤ A_max, so that the first slot adds
e + 1/2, or A_max, and every later one e − 1/2 + x − x²/2 or more. Their sum over the slots after
the first is that of the ages at the ends of all slots but the last, which has a bound of its own.
"""

from __future__ import annotations

import numpy as np

from iout_marl.errors import InputError
from iout_marl.scenario import Scenario, load_scenario
from iout_marl.scenario.parts import outside_parts


def in_whole_slots(scenario: Scenario) -> Scenario:
    """The scenario with `age.sampling: slot_end`, and a slot fewer, on which the bound rests.

    Raises:
        InputError: it has one slot alone.
    """
    if scenario.num_slots < 2:
        raise InputError(
            f"age.sampling: {scenario.age.sampling}: there is a bound for episodes of two slots "
            "and more"
        )
    changes = {
        "age.sampling": "slot_end",
        # Half a slot more, which is none: no rounding can take one away.
        "episode.duration_s": (scenario.num_slots - 0.5) * scenario.slot_s,
    }
    return load_scenario(scenario, changes)


def mean_over_time(scenario: Scenario, mean_age: float) -> float:
    """A lower bound on the mean AoI by one on that of `in_whole_slots`, in slots."""
    first, less = _first_and_less(scenario)
    return (first + (scenario.num_slots - 1) * (mean_age - less)) / scenario.num_slots


def mean_in_whole_slots(scenario: Scenario, mean_over_time: float) -> float:
    """The mean AoI of `in_whole_slots` that leads to one over time."""
    first, less = _first_and_less(scenario)
    return (mean_over_time * scenario.num_slots - first) / (scenario.num_slots - 1) + less


def _first_and_less(scenario: Scenario) -> tuple[float, float]:
    """What the first slot adds for each node, and what every later one adds less than e."""
    first = min(scenario.age.initial + 0.5, scenario.age.maximum)
    shortest = _shortest_packet(scenario)
    return first, 0.5 - shortest + shortest**2 / 2


def _shortest_packet(scenario: Scenario) -> float:
    """A share of the slot that every packet takes at least; 0 where a part from outside says it."""
    uplink, duplex = scenario.uplink.part, scenario.duplex.part
    if [*outside_parts(scenario.uplink), *outside_parts(scenario.duplex)]:
        return 0.0
    if uplink.has_own_time:
        return min(float(uplink.least_time_s(np.zeros(1), 1)[0]) / scenario.slot_s, 1.0)
    return 0.0 if duplex.splits_slot else 1.0
