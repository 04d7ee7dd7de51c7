"""The trainer as a whole: it learns, it is deterministic, it keeps to itself."""

import random

import numpy as np
import pytest
import torch

from iout_marl import World, evaluate, iout_v0
from iout_marl.world import node_codes
from trainers import TrainedPolicy, Trainer

VARIANTS = {
    "plain": {},
    "paper's reward, tdd": {"reward.kind": "paper", "duplex.kind": "tdd"},
    "all running": {
        "training.observation_scaling": "running",
        "training.reward_scaling": "running",
    },
    "nothing scaled": {
        "training.observation_scaling": "none",
        "training.reward_scaling": "none",
        "training.normalise_value": False,
        "training.normalise_advantage": False,
    },
    "nobody as a choice": {"auvs.idle_choices": True, "training.node_network": True},
    "nobody as a choice, tdd, masks": {
        "auvs.idle_choices": True,
        "duplex.kind": "tdd",
        "training.mask_actions": True,
    },
    "masks, relu, early stop": {
        "training.mask_actions": True,
        "training.activation": "relu",
        "training.target_kl": 1e-4,
    },
    "two auvs in random layouts": {
        "nodes": {"kind": "random", "count": 2},
        "auvs.start_cells": [[2, 1, 1], [1, 2, 1]],
        "training.rollout_slots": 7,
    },
}


def trained(scenario, seed=0, iterations=3):
    trainer = Trainer(scenario, seed)
    return trainer, [trainer.iterate() for _ in range(iterations)]


def without_speed(log):
    return {k: v for k, v in log.items() if not k.startswith("speed/")}


@pytest.fixture(scope="module")
def learnt(tiny):
    """A policy after some ten thousand steps in the tiny world."""
    changes = {
        "training.environments": 16,
        "training.steps": 16 * 20 * 40,
        "training.learning_rate": 1e-2,
        "training.hidden_units": [32],
        "training.epochs": 4,
    }
    trainer = Trainer(tiny(changes), seed=1)
    logs = []
    while not trainer.finished:
        logs.append(trainer.iterate())
    return trainer, logs


@pytest.mark.slow
def test_learns_a_tiny_task(learnt):
    trainer, _ = learnt
    metrics = evaluate(trainer.scenario, trainer.policy(), 1).metrics
    chance = evaluate(trainer.scenario, "random-walk", 200).metrics
    # Taking turns is best: ages of 1 and 2 at any time.
    assert metrics["mean_aoi"].mean < 1.6
    assert chance["mean_aoi"].mean > 2
    assert metrics["jain"].mean > 0.98
    assert metrics["reward"].mean > chance["reward"].mean + 10


@pytest.mark.slow
def test_logs_show_the_learning(learnt):
    _, logs = learnt
    first, last = logs[0], logs[-1]
    assert last["aoi/mean"] < first["aoi/mean"]
    assert last["ppo/entropy"] < first["ppo/entropy"]
    assert last["ppo/value_loss"] < first["ppo/value_loss"]
    assert abs(first["ppo/kl"]) < 0.5
    assert first["ppo/learning_rate"] == 1e-2
    assert last["ppo/learning_rate"] == pytest.approx(1e-2 / 40)


def test_loss_is_the_sum_of_its_terms(tiny):
    scenario = tiny({"training.value_coefficient": 0.7, "training.entropy_coefficient": 0.03})
    _, (log, *_) = trained(scenario)
    terms = log["ppo/policy_loss"] + 0.7 * log["ppo/value_loss"] - 0.03 * log["ppo/entropy"]
    assert log["ppo/loss"] == pytest.approx(terms, abs=1e-5)


def test_losses_are_those_of_the_clipped_surrogate(tiny):
    scenario = tiny(
        {"training.clip": 0.1, "training.mask_actions": True, "training.minibatches": 1}
    )
    trainer, _ = trained(scenario, iterations=1)
    rollout = trainer.collector.collect(trainer.network, 20, use_mask=True)
    rng = np.random.default_rng(0)
    samples = rollout.value.numel()
    data = rollout.samples()
    # As if the policy had moved since: some ratios are clipped, some are not.
    data["log_probability"] += torch.from_numpy(rng.normal(0, 0.2, (1, samples))).float()
    data["returns"] = torch.from_numpy(rng.normal(0, 1, (1, samples))).float()
    raw = torch.from_numpy(rng.normal(3, 2, (1, samples))).float()
    minibatches = trainer.turn.minibatches.cut(
        {**data, "advantage": raw}, torch.arange(samples)[None]
    )
    ((batch, counted),) = minibatches
    assert counted == samples
    with torch.no_grad():
        logits = trainer.network.logits(batch["inputs"], batch["mask"])
        policy = trainer.network.log_probabilities(logits)
        value = trainer.network.normalised_value(batch["inputs"])
        now = trainer.network.log_probability(policy, batch["action"])
    found = {k: float(v) for k, v in trainer._step(batch, samples, 1e-3).items()}

    ratio = (now - batch["log_probability"]).exp().flatten().tolist()
    advantage = ((raw - raw.mean()) / raw.std()).flatten().tolist()
    surrogate = [
        min(r * a, min(max(r, 0.9), 1.1) * a) for r, a in zip(ratio, advantage, strict=True)
    ]
    clipped = [not 0.9 <= r <= 1.1 for r in ratio]
    assert 0 < sum(clipped) < samples
    assert found["policy_loss"] == pytest.approx(-np.mean(surrogate), abs=1e-5)
    assert found["clip_fraction"] == pytest.approx(np.mean(clipped))
    assert found["kl"] == pytest.approx(np.mean([r - 1 - np.log(r) for r in ratio]), abs=1e-5)
    assert found["value_loss"] == pytest.approx(((value - batch["returns"]) ** 2).mean().item())
    entropy = -(policy.exp() * policy).sum((-2, -1))
    assert found["entropy"] == pytest.approx(entropy.mean().item())


@pytest.mark.parametrize("kind", ["none", "first_rollout"])
def test_values_are_learnt_in_units_of_the_reward_scale(tiny, kind):
    # Without a future, returns are rewards.
    changes = {"training.discount": 0, "training.reward_scaling": kind}
    trainer, (log,) = trained(tiny(changes), iterations=1)
    assert (trainer.reward_scale.divisor != 1) == (kind != "none")
    expected = log["reward/total"] / float(trainer.reward_scale.divisor)
    assert trainer.network.return_mean.item() == pytest.approx(expected, rel=1e-4)


def test_running_scaler_takes_in_every_rollout(tiny):
    scenario = tiny({"training.observation_scaling": "running"})
    trainer, _ = trained(scenario, iterations=1)
    twin = Trainer(scenario)
    seen = twin.collector.collect(twin.network, 20, use_mask=False).observation.flatten(0, 3)
    scaler = trainer.network.scaler
    assert scaler.count == 80
    torch.testing.assert_close(scaler.shift[0], seen.mean(0))
    torch.testing.assert_close(scaler.scale[0], seen.std(0, correction=0).clamp_min(1e-4))


def test_every_sample_is_learnt_from_once_an_epoch(tiny):
    trainer = Trainer(tiny({"training.minibatches": 3}))
    data = {"number": torch.arange(80)[None], "advantage": torch.zeros(1, 80)}
    epochs = [
        list(trainer.turn.minibatches.cut(data, order))
        for order in trainer.turn.minibatches.orders(20, trainer.settings.epochs)
    ]
    assert len(epochs) == trainer.settings.epochs > 1
    for epoch in epochs:
        found = [(batch["number"].shape[-1], samples) for batch, samples in epoch]
        assert found == [(27, 27), (27, 27), (26, 26)]
        order = torch.cat([batch["number"][0] for batch, _ in epoch])
        assert torch.equal(order.sort().values, torch.arange(80))
    assert not torch.equal(epochs[0][0][0]["number"], epochs[1][0][0]["number"])


@pytest.mark.slow
@pytest.mark.parametrize("changes", VARIANTS.values(), ids=list(VARIANTS))
def test_same_seed_trains_bit_for_bit_the_same(tiny, changes):
    scenario = tiny(changes)
    (first, first_logs), (second, second_logs) = trained(scenario), trained(scenario)
    for name, tensor in first.network.state_dict().items():
        assert torch.equal(tensor, second.network.state_dict()[name]), name
        assert tensor.isfinite().all(), name
    assert [*map(without_speed, first_logs)] == [*map(without_speed, second_logs)]
    assert all(np.isfinite(list(log.values())).all() for log in first_logs)


def test_other_seed_trains_another_policy(tiny):
    (first, _), (second, _) = (trained(tiny(), seed, 1) for seed in (0, 1))
    weights = [t.network.actor[0].weight for t in (first, second)]
    assert not torch.equal(*weights)


def test_global_generators_stay_as_they_were(tiny):
    torch_state, python_state = torch.get_rng_state(), random.getstate()
    numpy_state = np.random.get_state(legacy=False)["state"]  # noqa: NPY002
    trained(tiny(VARIANTS["two auvs in random layouts"]))
    assert torch.equal(torch.get_rng_state(), torch_state)
    assert random.getstate() == python_state
    after = np.random.get_state(legacy=False)["state"]  # noqa: NPY002
    assert (after["key"] == numpy_state["key"]).all()
    assert after["pos"] == numpy_state["pos"]


def test_global_generators_do_not_matter(tiny):
    torch.manual_seed(11)
    first, _ = trained(tiny(), iterations=1)
    torch.manual_seed(12)
    second, _ = trained(tiny(), iterations=1)
    assert torch.equal(first.network.actor[0].weight, second.network.actor[0].weight)


@pytest.mark.parametrize(
    "changes",
    [
        {"training.environments": 1, "training.rollout_slots": 2, "training.minibatches": 2},
        {"training.environments": 1, "training.rollout_slots": 3, "training.minibatches": 2},
    ],
    ids=["one sample each", "uneven"],
)
def test_smallest_minibatches_leave_no_nan(tiny, changes):
    trainer, logs = trained(tiny(changes))
    assert all(np.isfinite(list(log.values())).all() for log in logs)
    assert all(p.isfinite().all() for p in trainer.network.parameters())


def test_early_stop_takes_fewer_epochs(tiny):
    scenario = tiny({"training.epochs": 20, "training.learning_rate": 1e-2})
    stopping = tiny(
        {"training.epochs": 20, "training.learning_rate": 1e-2, "training.target_kl": 1e-4}
    )
    steps = []
    for each in (scenario, stopping):
        trainer, _ = trained(each, iterations=1)
        steps.append(trainer.optimizer.steps)
    assert steps[0] == 20 * scenario.training.minibatches
    assert steps[1] < steps[0]


def test_environment_steps_are_counted_and_may_overshoot(tiny):
    trainer = Trainer(tiny({"training.steps": 100}))
    assert trainer.steps_per_iteration == 80
    trainer.iterate()
    assert (trainer.env_steps, trainer.finished) == (80, False)
    trainer.iterate()
    assert (trainer.env_steps, trainer.finished) == (160, True)


def test_metrics_of_episodes_are_logged_only_where_some_ended(tiny):
    _, logs = trained(tiny({"training.rollout_slots": 15}), iterations=3)
    assert ["aoi/mean" in log for log in logs] == [False, True, True]


@pytest.mark.slow
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"duplex.kind": "tdd", "training.mask_actions": True},
        VARIANTS["two auvs in random layouts"],
    ],
    ids=["fdd", "tdd with masks", "two auvs"],
)
def test_trained_policy_plays_as_its_network_does_in_the_environment(tiny, changes):
    trainer, _ = trained(tiny(changes), iterations=5)
    network, use_mask = trainer.policy().network, trainer.settings.mask_actions
    policy = TrainedPolicy(network, use_mask=use_mask)
    evaluation = evaluate(trainer.scenario, policy, episodes=3, seed=5)

    scenario = trainer.scenario.model_copy(
        update={"observation": trainer.scenario.observation.model_copy(
            update={"action_mask": "info"})}
    )  # fmt: skip
    env = iout_v0.parallel_env(scenario)
    for episode in range(evaluation.episodes):
        observations, infos = env.reset(seed=5 + episode)
        total = 0.0
        while env.agents:
            stacked = torch.from_numpy(np.stack([observations[a] for a in env.agents]))
            masks = np.stack([infos[a]["action_mask"] for a in env.agents]) > 0
            mask = torch.from_numpy(masks) if use_mask else None
            with torch.no_grad():
                logits = network.logits(network.scaler(stacked), mask)
            chosen = logits.argmax(-1).numpy()
            actions = dict(zip(env.agents, chosen, strict=True))
            observations, rewards, _, _, infos = env.step(actions)
            total += np.mean(list(rewards.values()))
        assert evaluation.samples["reward"][episode] == pytest.approx(total)
        jain = infos["auv_0"]["jain"]
        assert evaluation.samples["jain"][episode] == pytest.approx(jain)


def test_policy_trained_with_masks_plays_with_them(tiny):
    trainer = Trainer(tiny({"training.mask_actions": True}))
    world = World(trainer.scenario)
    state = world.reset(node_codes(trainer.scenario, world.grid, [None]))
    down = 5  # out of the grid of one layer
    network = trainer.policy().network
    with torch.no_grad():
        network.actor[-1].bias[down] = 100
    for use_mask in (False, True):
        policy = TrainedPolicy(network, use_mask=use_mask)
        direction = policy.act(world, state, np.random.default_rng(0))[0, 0, 0]
        assert (direction == down) != use_mask


def test_stochastic_policy_samples_from_the_stream_of_the_evaluation(tiny):
    trainer, _ = trained(tiny(), iterations=1)
    policy = TrainedPolicy(trainer.policy().network, sampled=True)
    first, second = (evaluate(trainer.scenario, policy, 4, seed=s) for s in (0, 0))
    other = evaluate(trainer.scenario, policy, 4, seed=1)
    assert np.array_equal(first.samples["reward"], second.samples["reward"])
    assert not np.array_equal(first.samples["reward"], other.samples["reward"])
    assert len(set(first.samples["reward"])) > 1
