"""Networks that are registered from outside: trained, saved, loaded, refused."""

import pytest
import torch
from torch import nn

from iout_marl import InputError, evaluate, load_policy, load_scenario, parts
from trainers import Trainer, train

pytestmark = pytest.mark.usefixtures("forgotten_parts")

VARIANTS = {
    "plain": {},
    "tdd, masks, running scalers": {
        "duplex.kind": "tdd",
        "training.mask_actions": True,
        "training.observation_scaling": "running",
    },
    "a critic that sees more, a network for nodes": {
        "auvs.start_cells": [[2, 1, 1], [1, 2, 1]],
        "training.critic": "central",
        "training.node_network": True,
    },
}


def perceptron(inputs, width, outputs):
    return nn.Sequential(nn.Linear(inputs, width), nn.ReLU(), nn.Linear(width, outputs))


@pytest.fixture
def mine():
    """A network of a user's: buffers that are saved and not, weights frozen and unused."""

    class Actor(nn.Module):
        def __init__(self, inputs, width, outputs):
            super().__init__()
            self.layers = perceptron(inputs, width, outputs)
            self.unused = nn.Linear(2, 3)
            self.frozen = nn.Parameter(torch.rand(outputs), requires_grad=False)
            self.register_buffer("factors", 1 + torch.rand(outputs))
            self.register_buffer("places", torch.arange(outputs) / outputs, persistent=False)

        def forward(self, inputs):
            return self.layers(inputs) * self.factors + self.places + self.frozen

    @parts.networks.register("mine", version=1)
    class Mine(parts.Network):
        class Settings(parts.Settings):
            width: parts.Count = 5

        def make_actor(self, sizes):
            return Actor(sizes.observation_entries, self.settings.width, sizes.choices)

        def make_critic(self, sizes):
            return perceptron(sizes.critic_entries, self.settings.width, 1)

    return Mine


class BatchStatistics(nn.Module):
    """Batch normalisation over all axes but the last."""

    def forward(self, inputs):
        if not self.training:
            return inputs
        axes = tuple(range(inputs.ndim - 1))
        return inputs - inputs.mean(axes, keepdim=True)


def with_layer(sizes, layer):
    return nn.Sequential(nn.Linear(sizes.observation_entries, sizes.choices), layer)


def broken(**methods):
    """Registers a network with other methods."""

    class Broken(parts.Network):
        def make_actor(self, sizes):
            return nn.Linear(sizes.observation_entries, sizes.choices)

        def make_critic(self, sizes):
            return nn.Linear(sizes.critic_entries, 1)

    for name, method in methods.items():
        setattr(Broken, name, method)
    parts.networks.register("broken", version=1)(Broken)


@pytest.mark.slow
@pytest.mark.parametrize("changes", VARIANTS.values(), ids=list(VARIANTS))
def test_each_of_several_policies_is_what_it_would_be_alone(tiny, mine, changes):
    scenario = tiny({**changes, "training.network": "mine"})
    together = Trainer(scenario, 5, replicas=2)
    logs = [together.iterate_all() for _ in range(3)]
    for policy in range(2):
        alone = Trainer(scenario, 5 + policy)
        before = alone.weights()
        for log in logs:
            found = alone.iterate()
            for tag in ("ppo/loss", "ppo/entropy", "aoi/mean"):
                assert found.get(tag) == pytest.approx(log[policy].get(tag), rel=1e-3, abs=1e-4)
        for name, tensor in alone.weights().items():
            torch.testing.assert_close(tensor, together.weights(policy)[name], rtol=1e-4, atol=1e-5)
        moved = [name for name in before if not torch.equal(before[name], alone.weights()[name])]
        assert {"actor.module.layers.0.weight", "critic.0.module.0.weight"} <= set(moved)


def test_values_stay_what_they_are_when_returns_are_normalised_anew(tiny, mine):
    trainer = Trainer(tiny({"training.network": "mine"}), replicas=2)
    trainer.iterate_all()
    seen = trainer.collector.observe()
    before = trainer.collector.value(trainer.network)
    moments = trainer._moments(100 + 7 * torch.randn(20, 2, 4, 1))
    trainer.network.update_popart(moments)
    torch.testing.assert_close(
        trainer.collector.value(trainer.network), before, rtol=1e-3, atol=1e-2
    )
    assert torch.equal(seen, trainer.collector.observe())


@pytest.mark.slow
def test_a_run_is_loaded_evaluated_and_resumed(tiny, mine, tmp_path):
    changes = {"training.learning_rate_schedule": "constant"}
    short, long = (tiny({**changes, "training.steps": steps}) for steps in (160, 320))
    network = {"kind": "mine", "width": 7}
    whole = train(long, tmp_path / "whole", network=network, evaluation_episodes=2)
    train(short, tmp_path / "run", network=network, evaluation_episodes=2)
    again = train(long, tmp_path / "run", network=network, resume=True, evaluation_episodes=2)
    first, second = whole.trainer.weights(), again.trainer.weights()
    assert all(torch.equal(tensor, second[name]) for name, tensor in first.items())
    scenario = again.run.scenario()
    assert scenario.training.network.width == 7
    policy = load_policy(tmp_path / "run")
    found = evaluate(scenario, policy, 2, seed=0).metrics["mean_aoi"].mean
    assert found == again.evaluation.metrics["mean_aoi"].mean


def test_what_is_saved_is_what_was_trained(tiny, mine):
    trainer = Trainer(tiny({"training.network": "mine"}), replicas=2)
    trainer.iterate_all()
    seen = trainer.collector.observe()
    with torch.no_grad():
        together = trainer.network.logits(trainer.network.scaler(seen))
        for i in range(2):
            network = trainer.policy(i).network
            found = network.logits(network.scaler(seen[i]))
            torch.testing.assert_close(found, together[i], rtol=1e-5, atol=1e-6)
    frozen = trainer.weights()["actor.module.frozen"]
    assert torch.equal(frozen, Trainer(trainer.source).weights()["actor.module.frozen"])


def test_hash_knows_kind_settings_and_version(mine):
    names = ["mlp", "mine", {"kind": "mine", "width": 6}]
    hashes = {load_scenario("paper/k3-fdd", {"training.network": name}).hash for name in names}
    assert len(hashes) == 3
    assert load_scenario("paper/k3-fdd").hash in hashes
    worlds = {load_scenario("paper/k3-fdd", {"training.network": n}).world_hash for n in names}
    assert len(worlds) == 1


def test_logits_may_be_those_of_all_choices(tiny, mine):
    trainer = Trainer(tiny({"training.network": "mine"}))
    network, sizes = trainer.network, trainer.collector.world.action_sizes
    seen = trainer.collector.observe()
    with torch.no_grad():
        flat = network.actor(network.scaler(seen))
        logits = network.logits(network.scaler(seen))
    for entry, part in enumerate(flat.split(sizes, dim=-1)):
        assert torch.equal(logits[..., entry, : sizes[entry]], part)
        assert (logits[..., entry, sizes[entry] :] < -1e8).all()


@pytest.mark.parametrize(
    ("methods", "fault"),
    [
        ({"make_actor": lambda self, sizes: "me"}, "its actor is no torch.nn.Module, but a str"),
        (
            {"make_actor": lambda self, sizes: nn.Linear(sizes.observation_entries, 4)},
            r"its actor makes \(2, 4\) of \(2, \d+\), not \(2, \d+\)",
        ),
        (
            {"make_critic": lambda self, sizes: nn.Linear(sizes.critic_entries, 2)},
            r"its critic makes \(2, 2\) of \(2, \d+\), not \(2, 1\)",
        ),
        (
            {"make_critic": lambda self, sizes: nn.Flatten(-2)},
            r"its critic makes ",
        ),
        (
            {"make_actor": lambda self, sizes: 1 / 0},
            r"raises ZeroDivisionError: division by zero \(.*test_networks_from_outside\.py:\d+\)",
        ),
        (
            {"make_critic": lambda self, sizes: nn.Linear(sizes.critic_entries + 1, 1)},
            r"raises RuntimeError: ",
        ),
        *(
            (
                {"make_actor": lambda self, sizes, layer=layer: with_layer(sizes, layer)},
                "its actor does something else in training than in evaluation",
            )
            for layer in (nn.Dropout(0.5), BatchStatistics())
        ),
    ],
    ids=[
        *("no module", "too few logits", "two values", "no value", "raises", "other inputs"),
        *("dropout", "batch statistics"),
    ],
)
def test_what_does_not_work_is_refused_before_anything_is_written(tiny, tmp_path, methods, fault):
    broken(**methods)
    with pytest.raises(InputError, match=f"network 'broken': {fault}") as raised:
        train(tiny(), tmp_path / "run", network="broken")
    assert str(raised.value).isprintable()
    assert not (tmp_path / "run").exists()


def test_numbers_that_are_not_finite_are_refused(tiny):
    class Log(nn.Linear):
        def forward(self, inputs):
            return super().forward(inputs) * torch.inf

    broken(make_critic=lambda self, sizes: Log(sizes.critic_entries, 1))
    with pytest.raises(InputError, match="its critic makes numbers that are not finite"):
        Trainer(tiny(), network="broken")


@pytest.mark.parametrize("network", ["mpl", {"kind": "mpl"}, 3], ids=["word", "mapping", "number"])
def test_unknown_network(tiny, network):
    with pytest.raises(InputError, match=r"training\.network"):
        Trainer(tiny(), network=network)
