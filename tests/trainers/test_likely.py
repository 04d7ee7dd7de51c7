"""The most probable actions: of one AUV, and of several."""

import itertools

import numpy as np
import pytest
import torch

from iout_marl import load_scenario
from iout_marl.world import World
from trainers import Trainer
from trainers.likely import likely_actions, likely_together
from trainers.networks import IMPOSSIBLE

SET = {"kind": "set", "width": 8, "blocks": 1, "heads": 2, "pair_width": 4, "critic_width": 8}
NETWORKS = {
    "mlp": {},
    "set": {"training.network": SET, "observation": {"kind": "table"}},
}


@pytest.fixture(params=NETWORKS)
def played(request):
    """A policy whose choices differ much, a world, and a state some slots on."""
    settings = NETWORKS[request.param] | {"training.mask_actions": True}
    scenario = load_scenario("paper/k3-fdd", settings)
    torch.manual_seed(0)
    policy = Trainer(scenario).policy()
    for weights in policy.network.actor.parameters():
        weights.data += 0.3 * torch.randn(weights.shape)
    world = World(scenario, 5)
    state = world.reset(seed=0)
    for _ in range(9):
        state, _ = world.step(state, policy.act(world, state, np.random.default_rng(0)))
    return policy, world, state


def test_likely_actions(played):
    """In the order of their probability, as all actions one by one say it."""
    policy, world, state = played
    network, observation, mask, _ = policy._seen(world, state)
    inputs = network.scaler(torch.as_tensor(observation, dtype=torch.float32))
    allowed = torch.as_tensor(mask)
    every = torch.tensor(list(itertools.product(*map(range, world.action_sizes))))
    shape = (5, 1, len(every))
    seen = inputs[:, :, None].expand(*shape, -1)
    action = every.expand(*shape, -1)
    logits = network.logits(seen, allowed[:, :, None].expand(*shape, -1), action)
    expected = network.log_probability(network.log_probabilities(logits), action)
    actions, found = likely_actions(network, inputs, allowed, len(every) + 1)
    assert actions.shape == (*shape, 3)
    ordered = expected.sort(-1, descending=True).values
    # The most probable one in the place of those that are masked.
    ordered = torch.where(ordered > IMPOSSIBLE / 2, ordered, ordered[..., :1])
    torch.testing.assert_close(found, ordered, rtol=1e-4, atol=1e-4)
    number = (actions * torch.tensor([9, 3, 1])).sum(-1)
    torch.testing.assert_close(expected.gather(-1, number), ordered, rtol=1e-4, atol=1e-4)


def test_the_first_is_what_the_policy_does(played):
    policy, world, state = played
    policy.sampled = True
    likely = policy.likely_actions(world, state, 6)
    assert policy.sampled
    policy.sampled = False
    assert likely.shape == (5, 6, 1, 3)
    assert (likely[:, 0] == policy.act(world, state, np.random.default_rng(0))).all()
    assert all(len({row.tobytes() for row in env}) == 6 for env in likely)


def test_no_action_that_is_masked(played):
    """Where fewer are allowed than are asked for."""
    policy, world, _ = played
    state = world.reset(seed=0)
    mask = world.action_mask(state)[:, 0]
    likely = policy.likely_actions(world, state, 10_000)[:, :, 0]
    offsets = np.cumsum([0, *world.action_sizes[:-1]])
    allowed = mask[np.arange(len(mask))[:, None, None], likely + offsets]
    assert allowed.all()
    assert not mask.all()


def test_of_several_together():
    """As all pairs of what they would do say it."""
    torch.manual_seed(1)
    log_probability = torch.randn(4, 3, 5).sort(-1, descending=True).values
    actions = torch.arange(60).reshape(4, 3, 5, 1)
    joint = likely_together(actions, log_probability)
    assert joint.shape == (4, 5, 3, 1)
    for env in range(4):
        sums = {
            index: sum(log_probability[env, auv, i] for auv, i in enumerate(index))
            for index in itertools.product(range(5), repeat=3)
        }
        best = sorted(sums, key=sums.get, reverse=True)[:5]
        expected = [[int(actions[env, auv, i, 0]) for auv, i in enumerate(each)] for each in best]
        assert joint[env, :, :, 0].tolist() == expected
