"""Networks for node tables of any size: symmetry, sizes, gradients, what they learn."""

import numpy as np
import pytest
import torch

from iout_marl.errors import InputError
from iout_marl.scenario import load_scenario
from iout_marl.world import World
from trainers import Trainer
from trainers.factory import make_network
from trainers.networks import stacked, uniform_noise
from trainers.set_ops import mixed, pooled, reference_mixed, reference_pooled
from trainers.sets import Rows

ENVS = 5
SMALL = {"kind": "set", "width": 16, "blocks": 1, "heads": 2, "pair_width": 8, "critic_width": 16}
SCENARIOS = {
    "fdd": ("random/k5-fdd", {}),
    "tdd": ("random/k5-tdd", {}),
    "one node": ("random/k5-fdd", {"nodes.count": 1}),
    "team": ("multi/m3-k10-fdd", {}),
    "nobody": ("random/k5-fdd", {"auvs.idle_choices": True}),
    "sea": ("sea/bay-tide", {"training.node_network": False}),
}


def table(name, overrides=None, network=None):
    changes = {"observation": {"kind": "table"}, "training.network": network or SMALL}
    return load_scenario(name, {**changes, **(overrides or {})})


def network_for(world, settings):
    torch.manual_seed(0)
    made = make_network(world.observer, world.action_sizes, settings)
    with torch.no_grad():  # policies worth the name, far from uniform
        for name, parameter in made.actor.named_parameters():
            if name.startswith(("direction.", "node.", "nobody.", "chosen")):
                parameter.copy_(torch.randn_like(parameter))
    return made


class Played:
    """A scenario's world and a network, and what it sees after some random slots."""

    def __init__(self, scenario):
        self.scenario = scenario
        self.world = World(scenario, ENVS, dtype="float32")
        rng = np.random.default_rng(0)
        state = self.world.reset(seed=0)
        for _ in range(6):
            shape = (ENVS, self.world.num_auvs)
            sizes = self.world.action_sizes
            action = np.stack([rng.integers(0, n, shape) for n in sizes], axis=-1)
            chance = self.world.expected if self.world.chance else None
            state = self.world.step(state, action, chance)[0]
        self.network = network_for(self.world, scenario.training)
        self.seen = torch.as_tensor(np.asarray(self.world.observe(state)), dtype=torch.float32)
        self.mask = torch.as_tensor(np.asarray(self.world.action_mask(state)))


@pytest.fixture(params=SCENARIOS.values(), ids=list(SCENARIOS), scope="module")
def played(request):
    return Played(table(*request.param))


def permuted(layout, seen, nodes, auvs):
    """Observations whose rows stand in another order."""
    rows = Rows.from_flat(layout, seen.mT)
    moved = (
        rows.context.squeeze(-2),
        rows.auvs[..., auvs, :].flatten(-3, -2),
        rows.nodes[..., nodes, :].flatten(-3, -2),
        rows.moves[..., nodes, :].flatten(-4, -2),
    )
    return torch.cat(moved, dim=-2).mT


def test_the_order_of_rows_does_not_matter(played):
    network, layout = played.network, played.world.observer.layout
    nodes, auvs = (
        torch.randperm(n, generator=torch.Generator().manual_seed(3))
        for n in (layout.nodes, layout.auvs)
    )
    other = permuted(layout, played.seen, nodes, auvs)
    sizes = network.action_sizes
    action, _ = network.act(
        played.seen,
        None,
        uniform_noise((*played.seen.shape[:-1], len(sizes)), torch.Generator().manual_seed(0)),
    )
    of_old = torch.argsort(nodes)
    same = action.clone()
    same[..., 1:] = torch.where(
        action[..., 1:] < layout.nodes,
        of_old[action[..., 1:].clamp_max(layout.nodes - 1)],
        action[..., 1:],
    )
    expected = network.logits(played.seen, action=action)
    found = network.logits(other, action=same)
    torch.testing.assert_close(found[..., 0, : sizes[0]], expected[..., 0, : sizes[0]])
    torch.testing.assert_close(found[..., 1:, : layout.nodes], expected[..., 1:, nodes])
    inputs = network.critic_inputs(played.seen, None), network.critic_inputs(other, None)
    torch.testing.assert_close(*(network.value(each) for each in inputs))


@pytest.mark.parametrize("mask", [False, True], ids=["no mask", "mask"])
def test_actions_have_the_probability_that_is_told(played, mask):
    network = played.network
    allowed = played.mask if mask else None
    noise = uniform_noise(
        (*played.seen.shape[:-1], len(network.action_sizes)), torch.Generator().manual_seed(0)
    )
    action, found = network.act(played.seen, allowed, noise)
    policy = network.log_probabilities(network.logits(played.seen, allowed, action))
    torch.testing.assert_close(found, network.log_probability(policy, action))
    if mask:
        starts = np.cumsum([0, *network.action_sizes[:-1]])
        assert played.mask.gather(-1, action + torch.as_tensor(starts)).all()


def test_all_actions_together_are_certain():
    """The probabilities of all actions, each given the entries before, sum to 1."""
    played = Played(table("random/k3-fdd"))
    network, sizes = played.network, played.network.action_sizes
    every = torch.cartesian_prod(*(torch.arange(n) for n in sizes))
    seen = played.seen[:, 0].unsqueeze(1).expand(-1, len(every), -1)
    action = every.expand(len(seen), -1, -1)
    policy = network.log_probabilities(network.logits(seen, action=action))
    total = network.log_probability(policy, action).exp().sum(-1)
    torch.testing.assert_close(total, torch.ones_like(total))
    # Not as if nodes did not know the direction, nor the one heard which one is charged.
    assert policy[..., 1, :3].std(1).max() > 1e-3
    charged = policy[:, :9, 2, :3].reshape(len(seen), 3, 3, 3)
    assert charged.std(1).max() > 1e-3


def test_most_probable_actions(played):
    network = played.network
    action = network.greedy_action(network.logits(played.seen, played.mask))
    logits = network.logits(played.seen, played.mask, action)
    torch.testing.assert_close(action, logits.argmax(-1))


def test_weights_serve_any_sizes(played):
    others = [Played(table("random/k7-fdd", {"auvs.count": 2})), Played(table("random/k10-fdd"))]
    for other in others:
        if len(other.network.action_sizes) != len(played.network.action_sizes):
            continue
        layout = other.world.observer.layout
        if layout.node_columns != played.world.observer.layout.node_columns:
            continue
        resized = played.network.sized_for(layout, other.world.action_sizes)
        assert {id(p) for p in resized.parameters()} == {id(p) for p in played.network.parameters()}
        other.network.load_state_dict(played.network.state_dict())
        torch.testing.assert_close(
            resized.logits(other.seen, other.mask), other.network.logits(other.seen, other.mask)
        )
        torch.testing.assert_close(resized.value(other.seen), other.network.value(other.seen))


def test_side_by_side_as_alone(played):
    networks = [played.network, network_for(played.world, played.scenario.training)]
    with torch.no_grad():
        for parameter in networks[1].parameters():
            parameter.add_(torch.randn_like(parameter), alpha=0.1)
    together = stacked(networks)
    seen = torch.stack([played.seen, played.seen.flip(0)])
    noise = uniform_noise(
        (*seen.shape[:-1], len(played.network.action_sizes)), torch.Generator().manual_seed(0)
    )
    action, log_probability = together.act(seen, None, noise)
    logits, value = together.logits(seen, None, action), together.value(seen)
    for i, network in enumerate(networks):
        own, own_probability = network.act(seen[i], None, noise[i])
        assert (own == action[i]).all()
        torch.testing.assert_close(own_probability, log_probability[i])
        torch.testing.assert_close(network.logits(seen[i], None, own), logits[i])
        torch.testing.assert_close(network.value(seen[i]), value[i])


REPLICAS = pytest.mark.parametrize("replicas", [(), (1,), (2,)], ids=["alone", "one", "two"])


def numbers(*shape):
    return torch.randn(*shape, dtype=torch.float64, requires_grad=True)


@pytest.mark.slow
@REPLICAS
@pytest.mark.parametrize("relu", [False, True], ids=["linear", "relu"])
def test_mixed(replicas, relu):
    torch.manual_seed(0)
    weight, bias = numbers(*replicas, 4, 9), numbers(*replicas, 4)
    inputs = [
        numbers(*replicas, n, *rows, 7) for n, rows in ((3, (3, 5)), (4, (1, 5)), (2, (1, 1)))
    ]
    torch.testing.assert_close(
        mixed(weight, bias, inputs, relu=relu), reference_mixed(weight, bias, inputs, relu=relu)
    )
    torch.autograd.gradcheck(lambda w, b, *x: mixed(w, b, x, relu=relu), (weight, bias, *inputs))
    onto = numbers(*replicas, 4, 3, 5, 7)
    torch.testing.assert_close(
        mixed(weight, bias, inputs, onto=onto), reference_mixed(weight, bias, inputs, onto=onto)
    )
    torch.autograd.gradcheck(
        lambda o, w, b, *x: mixed(w, b, x, onto=o), (onto, weight, bias, *inputs)
    )
    with torch.no_grad():
        torch.testing.assert_close(
            mixed(weight, bias, inputs, relu=relu), reference_mixed(weight, bias, inputs, relu=relu)
        )


@pytest.mark.slow
@REPLICAS
def test_pooled(replicas):
    torch.manual_seed(0)
    rows, share = numbers(*replicas, 6, 2, 5, 7), numbers(*replicas, 3, 2, 5, 7)
    for weights in (None, share):
        inputs = (rows,) if weights is None else (rows, weights)

        def of(*given):
            return pooled(given[0], given[1] if len(given) > 1 else None, len(replicas))

        torch.testing.assert_close(of(*inputs), reference_pooled(rows, weights, len(replicas)))
        torch.autograd.gradcheck(of, inputs)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"observation": {"kind": "paper"}}, "observation"),
        ({"training.network": {"kind": "set", "width": 30}}, "heads"),
        ({"training.network": {"kind": "set", "width": 0}}, "width"),
        ({"training.network": {"kind": "set", "depth": 3}}, "depth"),
        ({"training.critic": "central", "observation.view_range_m": 300.0}, "training.critic"),
        ({"auvs.count": 2, "reward.credit": "difference"}, "reward.credit"),
    ],
    ids=lambda value: str(value)[:40],
)
def test_what_does_not_go_together(changes, message):
    with pytest.raises(InputError, match=message):
        Trainer(table("random/k3-fdd", changes))


@pytest.mark.parametrize("more", [{"heads": 0}, {"blocks": 0}, {"critic_blocks": 0}], ids=str)
def test_smaller_networks(more):
    settings = {"training.environments": 4, "training.rollout_slots": 5, "training.minibatches": 2}
    trainer = Trainer(table("random/k3-tdd", settings, {**SMALL, **more}))
    before = trainer.weights()
    log = trainer.iterate()
    assert np.isfinite(log["ppo/loss"])
    after = trainer.weights()
    moved = {name for name in before if not torch.equal(before[name], after[name])}
    assert {"actor.trunk.nodes.weight", "critic.0.trunk.nodes.weight"} <= moved
