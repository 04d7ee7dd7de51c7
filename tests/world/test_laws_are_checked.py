"""The campaign of random slots finds worlds that break a law."""

import numpy as np
import pytest
from campaigns.slots import run

from iout_marl.parts.access.interference import Interference
from iout_marl.parts.beta_rule.stored import StoredRule
from iout_marl.parts.duplex.fdd import FrequencyDivision
from iout_marl.tracing.unrolled import unrolled_slot
from iout_marl.world import transition
from iout_marl.world.mask import ActionMask
from iout_marl.world.motion import Mover
from iout_marl.world.reception import Reception
from iout_marl.world.world import World

pytestmark = pytest.mark.slow

MASK, REWARD = ActionMask.__call__, World.reward
SPLIT, WHOLE = StoredRule.split, FrequencyDivision.split
COUNTS = Reception._counts


def _allows_every_direction(self, state):
    mask = MASK(self, state).copy()
    mask[..., :6] = True
    return mask


def _shifts_beta(self, *given):
    split = SPLIT(self, *given)
    return split._replace(beta=split.beta * 0.999)


def _charges_longer(self, *given):
    split = WHOLE(self, *given)
    return split._replace(charging_s=split.charging_s * 1.001)


#: What is put in whose place, and what the campaign says of it.
BROKEN = {
    "energy from nowhere": (
        (FrequencyDivision, "split", _charges_longer),
        "what is harvested",
    ),
    "uplinks without energy": (
        (FrequencyDivision, "sends", lambda self, split, available_j: available_j >= 0),
        "an uplink",
    ),
    "ages without an end": (
        (transition, "advance", lambda xp, age, maximum: (age + 1, age + 1)),
        "ages rise by one",
    ),
    "AUVs in one cell": (
        (Mover, "_apart", lambda self, cell, target: target),
        "AUVs keep their separation",
    ),
    "a mask that leads out of the grid": (
        (ActionMask, "__call__", _allows_every_direction),
        "a masked move stays",
    ),
    "rewards by the order of the nodes": (
        (World, "reward", lambda self, *slot: REWARD(self, *slot) + slot[0].age[:, :1]),
        "permuted: rewards",
    ),
    "a β out of its interval": ((StoredRule, "split", _shifts_beta), "β|what is harvested"),
    "lost packets that nobody counts": (
        (Reception, "_counts", lambda self, judged: COUNTS(self, judged) * 0),
        "packets ",
    ),
    "one node for two AUVs": (
        (Interference, "to_nearest", lambda self, request: request.sends),
        "a node delivers once|energies",
    ),
}


@pytest.mark.parametrize(("replaced", "law"), BROKEN.values(), ids=BROKEN)
def test_a_broken_law_is_found(monkeypatch, replaced, law):
    monkeypatch.setattr(*replaced)
    unrolled_slot.cache_clear()
    faults, is_said = [], False
    # Not every draw has a scenario in which the law counts.
    for seed in range(12):
        faults += run(np.random.default_rng(seed), 1000).faults
        said = [fault.split("LawBrokenError: ")[-1] for fault in faults if "LawBroken" in fault]
        is_said = any(each.startswith(tuple(law.split("|"))) for each in said)
        if is_said:
            break
    unrolled_slot.cache_clear()
    assert is_said, faults[:3]
