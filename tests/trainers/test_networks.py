"""Actor, critic and what prepares their inputs, against torch.distributions and NumPy."""

import numpy as np
import pytest
import torch
from scipy.stats import chisquare
from torch.distributions import Categorical

from iout_marl import evaluate
from trainers import Trainer, train
from trainers.accel.group import ProcessGroup
from trainers.moments import Moments
from trainers.networks import ActorCritic, Scaler, perceptron, uniform_noise

SIZES = (6, 3, 2)


def unit_scaler():
    return Scaler(torch.zeros(4), torch.ones(4), 10.0)


def untrained(scaler, sizes, hidden_units, activation, **more):
    entries = len(scaler.shift)
    actor = perceptron(entries, hidden_units, len(sizes) * max(sizes), activation, 0.01)
    critic = perceptron(entries, hidden_units, 1, activation, 1.0)
    return ActorCritic(scaler, sizes, actor, critic, **more)


def network(activation="tanh", sizes=SIZES):
    torch.manual_seed(0)
    made = untrained(unit_scaler(), sizes, (8, 8), activation)
    with torch.no_grad():  # policies worth the name, far from uniform
        made.actor[-1].weight *= 100
    return made


def inputs(*shape):
    return torch.randn(*shape, 4, generator=torch.Generator().manual_seed(1))


def mask_of(*choices):
    mask = torch.zeros(sum(SIZES), dtype=torch.bool)
    mask[list(choices)] = True
    return mask


MASKS = {
    "no mask": None,
    "all": mask_of(*range(11)),
    "some": mask_of(0, 3, 4, 6, 8, 9, 10),
    "one each": mask_of(5, 7, 9),
}


def moments(values):
    """Of (…, entries) values, over all but the entries."""
    return Moments.from_values(values, tuple(range(values.ndim - 1)), ProcessGroup())


def moments_of(returns):
    return Moments.from_values(torch.as_tensor(returns), (0,), ProcessGroup())


def distributions(net, x, mask):
    """One torch distribution for each entry, from the same network."""
    flat = net.actor(x).unflatten(-1, (len(SIZES), -1))
    parts = [flat[..., i, :size] for i, size in enumerate(SIZES)]
    if mask is not None:
        allowed = mask.split(SIZES)
        parts = [p.masked_fill(~m, -torch.inf) for p, m in zip(parts, allowed, strict=True)]
    return [Categorical(logits=part) for part in parts]


@pytest.mark.parametrize("mask", MASKS.values(), ids=list(MASKS))
@pytest.mark.parametrize("activation", ["tanh", "relu"])
class TestAgainstCategorical:
    def test_log_probability(self, mask, activation):
        net, x = network(activation), inputs(50, 2)
        ours = net.log_probabilities(net.logits(x, mask))
        theirs = distributions(net, x, mask)
        action = torch.stack([d.sample() for d in theirs], -1)
        expected = sum(d.log_prob(a) for d, a in zip(theirs, action.unbind(-1), strict=True))
        torch.testing.assert_close(net.log_probability(ours, action), expected)

    def test_probabilities_of_each_entry(self, mask, activation):
        net, x = network(activation), inputs(7)
        found = net.log_probabilities(net.logits(x, mask)).exp()
        assert torch.allclose(found.sum(-1), torch.ones(7, 3))
        for i, expected in enumerate(distributions(net, x, mask)):
            torch.testing.assert_close(found[:, i, : SIZES[i]], expected.probs)
            assert (found[:, i, SIZES[i] :] == 0).all()

    def test_choice_is_the_most_probable_one(self, mask, activation):
        net, x = network(activation), inputs(50)
        found = net.greedy_action(net.logits(x, mask))
        expected = torch.stack([d.probs.argmax(-1) for d in distributions(net, x, mask)], -1)
        assert torch.equal(found, expected)


def test_mask_differs_by_row():
    net, x = network(), inputs(2, 1)
    mask = torch.stack([MASKS["some"], MASKS["one each"]])[:, None]
    together = net.log_probabilities(net.logits(x, mask))
    for row in range(2):
        alone = net.log_probabilities(net.logits(x[row], mask[row]))
        torch.testing.assert_close(together[row], alone, rtol=1e-6, atol=1e-6)


def test_masked_choices_are_never_drawn_and_have_zero_probability():
    net, x = network(), inputs(1).expand(20_000, 4)
    noise = uniform_noise((20_000, 3), torch.Generator().manual_seed(0))
    noise[:2] = torch.tensor([[2.0**-24], [1.0]])  # the ends of what may be drawn
    mask = MASKS["some"]
    action, log_probability = net.sample(net.logits(x, mask), noise)
    allowed = mask.split(SIZES)
    for i, entry in enumerate(action.unbind(-1)):
        assert allowed[i][entry].all()
    policy = net.log_probabilities(net.logits(x, mask))
    torch.testing.assert_close(log_probability, net.log_probability(policy, action))
    for i, size in enumerate(SIZES):
        assert (policy[0].exp()[i, :size][~allowed[i]] == 0).all()


def test_samples_follow_the_probabilities():
    net, x = network(), inputs(1)
    draws = 20_000
    noise = uniform_noise((draws, 3), torch.Generator().manual_seed(0))
    action, _ = net.sample(net.logits(x).expand(draws, 3, 6), noise)
    for i, expected in enumerate(distributions(net, x, None)):
        counts = np.bincount(action[:, i].numpy(), minlength=SIZES[i])
        probabilities = expected.probs[0].detach().double().numpy()
        assert chisquare(counts, draws * probabilities / probabilities.sum()).pvalue > 1e-3


def test_noise_is_seeded_and_never_0():
    first, second = (uniform_noise((10**6,), torch.Generator().manual_seed(5)) for _ in range(2))
    assert torch.equal(first, second)
    assert first.min() > 0
    assert first.max() <= 1
    assert first.mean().item() == pytest.approx(0.5, abs=0.01)


def test_untrained_policy_is_all_but_uniform():
    torch.manual_seed(0)
    net = untrained(unit_scaler(), SIZES, (64, 64), "tanh")
    found = net.log_probabilities(net.logits(inputs(100))).exp()
    for i, size in enumerate(SIZES):
        assert (found[:, i, :size] - 1 / size).abs().max() < 0.02


def test_hidden_units_and_activation_are_those_asked_for():
    net = untrained(unit_scaler(), SIZES, (5, 7), "relu")
    for part in (net.actor, net.critic):
        assert [m.out_features for m in part if isinstance(m, torch.nn.Linear)][:-1] == [5, 7]
        assert sum(isinstance(m, torch.nn.ReLU) for m in part) == 2


def test_value_in_the_units_of_returns():
    net, x = network(), inputs(5)
    net.return_mean.fill_(-30.0)
    net.return_std.fill_(4.0)
    torch.testing.assert_close(net.value(x), net.normalised_value(x) * 4 - 30)
    torch.testing.assert_close(net.normalised_return(net.value(x)), net.normalised_value(x))


def test_following_returns_preserves_all_values():
    net, x = network(), inputs(200)
    rng = np.random.default_rng(0)
    net.update_popart(
        Moments.from_values(torch.from_numpy(rng.normal(-30, 5, 1000)), (0,), ProcessGroup())
    )
    for mean, spread in ((-30, 5), (-10, 1), (50, 20), (0, 1e-3)):
        before = net.value(x)
        net.update_popart(
            Moments.from_values(
                torch.from_numpy(rng.normal(mean, spread, 1000)), (0,), ProcessGroup()
            )
        )
        torch.testing.assert_close(net.value(x), before, rtol=1e-4, atol=1e-3)


def test_following_returns_starts_at_the_first_and_moves_by_a_tenth():
    net = network()
    net.update_popart(moments_of([1.0, 3.0]))
    assert net.return_mean.item() == 2
    assert net.return_std.item() == pytest.approx(1)
    net.update_popart(moments_of([12.0, 12.0]))
    assert net.return_mean.item() == pytest.approx(3)
    assert net.return_std.item() == pytest.approx(0.9 + 0.1 * 1e-4)


def test_fixed_scaler_shifts_divides_and_clamps():
    scaler = Scaler(torch.tensor([1.0, 0.0]), torch.tensor([2.0, 0.5]), 4.0)
    found = scaler(torch.tensor([[3.0, 1.0], [-99.0, 99.0]]))
    assert found.tolist() == [[1, 2], [-4, 4]]
    scaler.update(moments(torch.randn(100, 2)))
    assert scaler.shift.tolist() == [1, 0]


@pytest.mark.parametrize(
    "shapes", [[(7, 5, 2)], [(3, 4, 1)] * 6, [(1, 1, 1), (50, 2, 3), (2, 2, 2)]]
)
def test_running_scaler_has_mean_and_variance_of_all_it_saw(shapes):
    rng = np.random.default_rng(0)
    offset, factor = np.array([0.0, -40.0, 1000.0]), np.array([1.0, 7.0, 0.5])
    batches = [rng.normal(size=(*shape, 3)) * factor + offset for shape in shapes]
    scaler = Scaler(torch.zeros(3), torch.ones(3), 10.0, running=True)
    for batch in batches:
        scaler.update(moments(torch.from_numpy(batch)))
    seen = np.concatenate([b.reshape(-1, 3) for b in batches])
    assert scaler.shift.numpy() == pytest.approx(seen.mean(0), rel=1e-4, abs=1e-4)
    assert scaler.scale.numpy() == pytest.approx(seen.std(0), rel=1e-3, abs=1e-3)
    assert scaler.count.item() == len(seen)


def test_entry_that_never_changes_is_not_divided_by_zero():
    scaler = Scaler(torch.zeros(1), torch.ones(1), 10.0, running=True)
    for _ in range(3):
        scaler.update(moments(torch.full((10, 1), 3.0)))
    assert scaler(torch.tensor([3.0])).item() == 0
    assert scaler(torch.tensor([4.0])).item() == 10


def test_scaler_travels_with_the_weights():
    net = network()
    net.scaler.running = True
    net.scaler.update(moments(inputs(100) * 3 + 1))
    other = network()
    other.load_state_dict(net.state_dict())
    assert torch.equal(other.scaler(inputs(5)), net.scaler(inputs(5)))


class TestNodeNetwork:
    """Two nodes; the observation is something else, two ages, two energies, something else."""

    def network(self, *, extra=True, sizes=(6, 2, 2)):
        torch.manual_seed(0)
        entries = (slice(1, 3), slice(3, 5)) if extra else None
        scaler = Scaler(torch.zeros(6), torch.ones(6), 10.0)
        made = untrained(scaler, sizes, (8,), "tanh", node_entries=entries)
        if extra:
            with torch.no_grad():
                made.node_actor[-1].weight *= 100
        return made

    def test_adds_the_same_function_of_age_and_energy_to_each_node(self):
        net = self.network()
        x = torch.randn(5, 6, generator=torch.Generator().manual_seed(1))
        added = net.logits(x) - net.actor(x).unflatten(-1, (3, 6)) - net.padding
        assert torch.equal(added[:, 0], torch.zeros(5, 6))
        for node in (0, 1):
            expected = net.node_actor(x[:, [1 + node, 3 + node]])
            torch.testing.assert_close(added[:, 1:, node], expected)

    def test_nodes_that_change_places_change_what_is_added(self):
        net = self.network()
        x = torch.randn(5, 6, generator=torch.Generator().manual_seed(1))
        swapped = x[:, [0, 2, 1, 4, 3, 5]]
        added, other = (
            net.logits(v)[:, 1:, :2] - net.actor(v).unflatten(-1, (3, 6))[:, 1:, :2]
            for v in (x, swapped)
        )
        torch.testing.assert_close(added, other.flip(-1))
        assert not torch.allclose(added, other)

    def test_more_nodes_than_directions(self):
        torch.manual_seed(0)
        scaler = Scaler(torch.zeros(21), torch.ones(21), 10.0)
        entries = (slice(3, 12), slice(12, 21))
        net = untrained(scaler, (6, 9), (8,), "tanh", node_entries=entries)
        policy = net.log_probabilities(net.logits(torch.randn(4, 21))).exp()
        assert policy.shape == (4, 2, 9)
        torch.testing.assert_close(policy[:, 0, :6].sum(-1), torch.ones(4))
        torch.testing.assert_close(policy[:, 1].sum(-1), torch.ones(4))

    def test_nobody_is_the_actors_own(self):
        torch.manual_seed(0)
        scaler = Scaler(torch.zeros(21), torch.ones(21), 10.0)
        entries = (slice(3, 12), slice(12, 21))
        net = untrained(scaler, (6, 10, 10), (8,), "tanh", node_entries=entries)
        inputs = torch.randn(4, 21)
        before = net.logits(inputs)
        with torch.no_grad():
            net.node_actor[-1].bias += 1
        changed = net.logits(inputs) - before
        torch.testing.assert_close(changed[:, 1:, :9], torch.ones(4, 2, 9))
        assert not changed[:, 1:, 9].any()
        assert not changed[:, 0].any()

    def test_is_trained_saved_and_loaded(self, tiny, tmp_path):
        scenario = tiny({"training.node_network": True, "auvs.count": 2})
        run = train(scenario, tmp_path / "run", evaluation_episodes=1).run
        policy = run.load_policy()
        last = Trainer(scenario).weights()["node_actor.2.weight"]
        assert not torch.allclose(policy.network.node_actor[-1].weight, last)
        assert evaluate(scenario, policy, 1).episodes == 1
