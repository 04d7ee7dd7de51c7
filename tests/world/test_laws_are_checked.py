"""The campaign of random slots finds worlds that break a law."""

import numpy as np
import pytest
from campaigns.slots import run

from iout_marl.world import world as world_module
from iout_marl.world.duplex import FrequencyDivision, StoredRule
from iout_marl.world.mask import ActionMask
from iout_marl.world.motion import Motion
from iout_marl.world.nodes import NodeAxis
from iout_marl.world.uplink import Exclusive, Interference
from iout_marl.world.world import World


def _more_energy(monkeypatch):
    charge = world_module.charge
    monkeypatch.setattr(world_module, "charge", lambda *given: charge(*given) * 1.001)


def _sends_without_energy(monkeypatch):
    monkeypatch.setattr(FrequencyDivision, "sends", lambda self, split, j: j >= 0)


def _age_without_an_end(monkeypatch):
    def advance(xp, age, maximum):
        return age + 1, age + 1

    monkeypatch.setattr(world_module, "advance", advance)


def _moves_through_one_another(monkeypatch):
    monkeypatch.setattr(Motion, "_apart", lambda self, cell, target: target)


def _mask_is_a_matter_of_luck(monkeypatch):
    whole = ActionMask.__call__

    def mask(self, state):
        found = whole(self, state).copy()
        found[..., :6] = True
        return found

    monkeypatch.setattr(ActionMask, "__call__", mask)


def _exclusive_is_not(monkeypatch):
    def both(self, request, split):
        delivered = self.to_nearest(request)
        return world_module.Request, delivered  # not what a world takes

    monkeypatch.setattr(Exclusive, "__call__", both)


def _rewards_depend_on_the_order(monkeypatch):
    reward = World.reward
    monkeypatch.setattr(
        World, "reward", lambda self, state, events: reward(self, state, events) + state.age[:, :1]
    )


def _beta_out_of_its_interval(monkeypatch):
    split = StoredRule.split

    def wrong(self, *given):
        found = split(self, *given)
        return found._replace(beta=found.beta * 0.999)

    monkeypatch.setattr(StoredRule, "split", wrong)


def _negative_energy(monkeypatch):
    plus = NodeAxis.plus
    monkeypatch.setattr(
        NodeAxis,
        "plus",
        lambda self, values, place, amount: plus(
            self, values, place, np.where(amount < 0, 2 * amount, amount)
        ),
    )


def _one_node_for_two(monkeypatch):
    monkeypatch.setattr(Interference, "to_nearest", lambda self, request: request.sends)


@pytest.mark.parametrize(
    ("break_it", "message"),
    [
        (_more_energy, "what is harvested"),
        (_sends_without_energy, "what is masked could not|an uplink is paid|no more is spent"),
        (_age_without_an_end, "ages rise by one"),
        (_moves_through_one_another, "AUVs keep their separation|who is"),
        (_mask_is_a_matter_of_luck, "a masked move stays"),
        (_exclusive_is_not, "Error"),
        (_rewards_depend_on_the_order, "permuted: rewards"),
        (_beta_out_of_its_interval, "β|who only charges"),
        (_negative_energy, "an uplink takes|an age"),
        (_one_node_for_two, "a node delivers once"),
    ],
    ids=lambda value: value.__name__.strip("_") if callable(value) else None,
)
def test_a_broken_law_is_found(monkeypatch, break_it, message):
    break_it(monkeypatch)
    tally = run(np.random.default_rng(1), 4000)
    assert tally.faults
    import re

    assert any(re.search(message, fault) for fault in tally.faults), tally.faults[0]
