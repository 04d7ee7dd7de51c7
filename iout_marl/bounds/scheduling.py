"""The scheduling bound: ages alone; energy, distance and luck aside."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from iout_marl.bounds.over_time import in_whole_slots, mean_over_time
from iout_marl.errors import InputError
from iout_marl.scenario import AnyScenario, Overrides, Scenario, load_scenario

Integers = npt.NDArray[np.int64]

#: A sum of ages of a whole episode is no more: it can be added up in 64 bits.
MOST_AGE_SUM = 2**62


def resets_per_slot(scenario: Scenario) -> int:
    """R, the number of ages that one slot can reset.

    An AUV hears as many nodes a slot as the hearing part says, one or more, and a node delivers to
    one AUV at most: min(M, K) or more, or less where the access part lets fewer uplinks arrive at
    the same time.
    """
    at_once: int = scenario.channel.part.access.max_uplinks_per_slot(scenario.num_auvs)
    in_turn: int = scenario.hearing.part.uplinks_per_slot
    return min(min(at_once, scenario.num_auvs) * in_turn, scenario.num_nodes)


def least_remaining_ages(ages: Integers, num_slots: int, maximum: int, resets: int) -> Integers:
    """The least sum of ages over the slots to come, if any R nodes can deliver in each.

    Resetting the R oldest in every slot is best: all ages grow alike, and whatever is reset
    in a slot, resetting an older node instead leaves the ages, in order, nowhere higher from
    then on.

    Args:
        ages: (states, nodes) ages now, in slots.
        num_slots: slots to come.
        maximum: A_max in slots.
        resets: R, from 1 to the number of nodes.

    Returns:
        (states,) sums over nodes and slots of the age after each slot.
    """
    num_nodes = ages.shape[1]
    oldest_first = -np.sort(-ages, axis=1)
    total = np.zeros(len(ages), dtype=np.int64)
    since_reset = 0
    for slot in range(1, min(num_slots, num_nodes) + 1):
        waiting = oldest_first[:, slot * resets :]
        total += np.minimum(waiting + slot, maximum).sum(axis=1)
        # The others were reset in turn, the last R of them in this slot.
        since = np.arange(num_nodes - waiting.shape[1]) // resets + 1
        since_reset = int(np.minimum(since, maximum).sum())
        total += since_reset
    # By then every node has been reset, and all further slots are alike.
    return total + max(num_slots - num_nodes, 0) * since_reset


def least_age_sum(scenario: AnyScenario, *, overrides: Overrides = None) -> int:
    """The least sum of ages over nodes and slots that any schedule of deliveries leads to.

    Args:
        scenario, overrides: as for `load_scenario`.

    Raises:
        InputError: no such scenario, its ages are no whole slots, or the sum may be too large for
            64 bits.
    """
    scenario = load_scenario(scenario, overrides)
    if scenario.age.is_continuous:
        raise InputError(
            f"age.sampling: {scenario.age.sampling}: sums of ages are bounded in whole slots, "
            "read at their ends (slot_end); `bound` makes a bound over time of that"
        )
    if scenario.num_nodes * scenario.num_slots * scenario.age.maximum > MOST_AGE_SUM:
        raise InputError(
            f"age.maximum: {scenario.num_slots:,} slots of so high ages cannot be added up in "
            "64 bits"
        )
    start = np.full((1, scenario.num_nodes), scenario.age.initial, dtype=np.int64)
    least = least_remaining_ages(
        start, scenario.num_slots, scenario.age.maximum, resets_per_slot(scenario)
    )
    return int(least[0])


def delivery_bound(scenario: AnyScenario, *, overrides: Overrides = None) -> float:
    """The scheduling bound: a lower bound on the mean AoI of any policy.

    It holds for nodes anywhere, and for unweighted ages, as `mean_aoi` has them.

    Args:
        scenario, overrides: as for `load_scenario`.

    Returns:
        mean over nodes and slots of the age after each slot, or over time, in slots.
    """
    scenario = load_scenario(scenario, overrides)
    if scenario.age.is_continuous:
        return mean_over_time(scenario, delivery_bound(in_whole_slots(scenario)))
    return least_age_sum(scenario) / scenario.num_nodes / scenario.num_slots
