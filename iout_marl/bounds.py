"""What no policy can beat."""

from __future__ import annotations

import numpy as np

from iout_marl.scenario import Scenario


def delivery_bound(scenario: Scenario) -> float:
    """A lower bound on the mean AoI of any policy: energy, distance and luck aside.

    An AUV hears one node a slot, and a node delivers to one AUV at most, so that a slot
    resets at most R = min(M, K) ages (one, where `channel.access` is `exclusive`). If R could
    be any nodes, resetting the R oldest in every slot would be best: all ages grow alike, and
    whatever is reset in a slot, resetting an older node instead leaves the ages, in order,
    nowhere higher from then on. What that rule gets is the bound. It holds for unweighted ages.

    Args:
        scenario: the scenario.

    Returns:
        mean over nodes and slots of the age after each slot, in slots.
    """
    resets = min(scenario.num_auvs, scenario.num_nodes)
    if scenario.channel.access == "exclusive":
        resets = 1
    age = np.full(scenario.num_nodes, float(scenario.age.initial))
    total = 0.0
    for _ in range(scenario.num_slots):
        age.sort()
        age = np.minimum(age + 1, scenario.age.maximum)
        age[-resets:] = 1
        total += float(age.mean())
    return total / scenario.num_slots
