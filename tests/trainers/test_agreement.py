"""AUVs that decide at once agree on whom each hears."""

import numpy as np
import pytest
import torch

from iout_marl import pretrained
from iout_marl.scenario import load_scenario
from iout_marl.world import World
from trainers import Trainer
from trainers.agreement import agreed
from trainers.networks import IMPOSSIBLE

NODES = 6
SMALL = {
    "observation": {"kind": "table"},
    "training.network": {"kind": "set", "width": 8, "blocks": 1, "heads": 2, "pair_width": 4},
}


def log_probabilities(logits, mask=None):
    if mask is not None:
        logits = logits.masked_fill(~mask, IMPOSSIBLE)
    return logits.log_softmax(-1)


def most_probable(seed, envs=200, auvs=4, choices=NODES, share_masked=0.3):
    generator = torch.Generator().manual_seed(seed)
    logits = 3 * torch.randn(envs, auvs, choices, generator=generator)
    mask = torch.rand(logits.shape, generator=generator) >= share_masked
    mask[..., 0] = True
    found = log_probabilities(logits, mask)
    return found.argmax(-1), found


def clashes(choice, nodes=NODES):
    """How many AUVs of each environment ask a node that another asks for, too."""
    named = torch.nn.functional.one_hot(choice, nodes + 1)[..., :nodes].sum(1)
    return (named - 1).clamp_min(0).sum(-1)


def test_no_node_is_asked_twice_where_there_are_others():
    choice, found = most_probable(0, share_masked=0.0)
    assert clashes(choice).sum() > 100
    after = agreed(choice, found, NODES)
    assert clashes(after).sum() == 0
    # Whoever is the surest of a node has it, and who asks for what nobody else does keeps it.
    own = found.gather(-1, choice[..., None]).squeeze(-1)
    for env in range(len(choice)):
        for node in choice[env].unique():
            those = (choice[env] == node).nonzero().flatten()
            keeps = those[own[env, those].argmax()]
            assert after[env, keeps] == node


def test_who_gives_way_takes_the_best_that_is_left():
    found = torch.tensor([[[0.5, 0.3, 0.2], [0.6, 0.1, 0.3], [0.1, 0.8, 0.1]]]).log()
    assert agreed(found.argmax(-1), found, 3).tolist() == [[2, 0, 1]]


def test_masks_are_heeded():
    choice, found = most_probable(1, auvs=5, share_masked=0.7)
    after = agreed(choice, found, NODES)
    assert clashes(after).sum() < clashes(choice).sum()
    assert (found.gather(-1, after[..., None]) > IMPOSSIBLE / 2).all()
    only = torch.tensor([[[True, False], [True, False]]])
    found = log_probabilities(torch.zeros(1, 2, 2), only)
    assert agreed(found.argmax(-1), found, 2).tolist() == [[0, 0]]


def test_nobody_may_be_heard_by_all():
    found = torch.tensor([[[0.1, 0.1, 0.8]] * 3]).log()
    assert agreed(found.argmax(-1), found, 2).tolist() == [[2, 2, 2]]
    found = torch.tensor([[[0.6, 0.1, 0.3], [0.7, 0.1, 0.2], [0.8, 0.05, 0.15]]]).log()
    assert agreed(found.argmax(-1), found, 2).tolist() == [[2, 2, 0]]


def test_more_auvs_than_nodes():
    choice, found = most_probable(2, auvs=9, share_masked=0.0)
    after = agreed(choice, found, NODES)
    assert (clashes(after) == 3).all()


def test_the_order_of_auvs_does_not_matter():
    choice, found = most_probable(3)
    order = torch.tensor([2, 0, 3, 1])
    one, other = agreed(choice, found, NODES), agreed(choice[:, order], found[:, order], NODES)
    assert torch.equal(one[:, order], other)


def team(duplex, changes=None):
    """Four AUVs on one band."""
    usual = {"auvs.count": 4, "channel.access": "interference"}
    return load_scenario(f"random/k10-{duplex}", usual | (changes or {}))


def heard_twice(scenario, policy):
    """In how many of an episode's slots, of eight layouts, a node is asked by two AUVs."""
    world = World(scenario, 8)
    rng = np.random.default_rng(0)
    state, found = world.reset(seed=3), 0
    for _ in range(scenario.num_slots):
        action = policy.act(world, state, rng)
        heard = np.sort(action[..., -1], axis=-1)
        found += int((np.diff(heard, axis=-1) == 0).any(-1).sum())
        state, _ = world.step(state, action)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("sampled", [False, True])
def test_a_fleet_agrees(sampled):
    assert heard_twice(team("fdd"), pretrained(sampled=sampled)) == 0


@pytest.mark.slow
def test_two_may_charge_and_hear_one_node_together():
    assert heard_twice(team("tdd"), pretrained()) > 0


def test_who_does_not_see_what_others_see_cannot_agree():
    limited = {"kind": "table", "view_range_m": 1000.0}
    scenario = team("fdd", SMALL | {"observation": limited})
    assert heard_twice(scenario, Trainer(scenario).policy()) > 0
