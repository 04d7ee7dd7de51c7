"""The scheduling bound: ages alone; energy, distance and luck aside."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from iout_marl.scenario import Scenario

Integers = npt.NDArray[np.int64]


def resets_per_slot(scenario: Scenario) -> int:
    """R, the number of ages that one slot can reset.

    An AUV hears one node a slot, and a node delivers to one AUV at most: min(M, K), or one
    where `channel.access` is `exclusive`.
    """
    if scenario.channel.access == "exclusive":
        return 1
    return min(scenario.num_auvs, scenario.num_nodes)


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
    for slot in range(1, num_slots + 1):
        waiting = oldest_first[:, slot * resets :]
        total += np.minimum(waiting + slot, maximum).sum(axis=1)
        # The others were reset in turn, the last R of them in this slot.
        since = np.arange(num_nodes - waiting.shape[1]) // resets + 1
        total += int(np.minimum(since, maximum).sum())
    return total


def least_age_sum(scenario: Scenario) -> int:
    """The least sum of ages over nodes and slots that any schedule of deliveries leads to."""
    start = np.full((1, scenario.num_nodes), scenario.age.initial, dtype=np.int64)
    least = least_remaining_ages(
        start, scenario.num_slots, scenario.age.maximum, resets_per_slot(scenario)
    )
    return int(least[0])


def delivery_bound(scenario: Scenario) -> float:
    """The scheduling bound: a lower bound on the mean AoI of any policy.

    It holds for nodes anywhere, and for unweighted ages, as `mean_aoi` has them.

    Args:
        scenario: the scenario.

    Returns:
        mean over nodes and slots of the age after each slot, in slots.
    """
    return least_age_sum(scenario) / scenario.num_nodes / scenario.num_slots
