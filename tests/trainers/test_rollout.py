"""What a rollout stores, against stepping the world again by hand."""

from dataclasses import fields, replace

import numpy as np
import pytest
import torch

from iout_marl import World
from iout_marl.core.state import SEA_FIELDS, STORE_FIELDS, TRANSIT_FIELDS, VEHICLE_FIELDS
from iout_marl.world import State, node_codes
from trainers.accel import Runtime
from trainers.collector import Collector
from trainers.factory import make_network
from trainers.networks import stacked

ENVS = 3
RANDOM_NODES = {"nodes": {"kind": "random", "count": 2}, "observation.node_positions": True}
SCENARIOS = {
    "plain": {},
    "tdd": {"duplex.kind": "tdd"},
    "two auvs": {"auvs.start_cells": [[2, 1, 1], [1, 2, 1]]},
    "random layouts": RANDOM_NODES,
    "paper's reward": {"reward.kind": "paper"},
    "central critic": {
        "auvs.start_cells": [[2, 1, 1], [1, 2, 1]],
        "training.critic": "central",
        "training.observation_scaling": "running",
        "reward.credit": "difference",
        "observation.view_range_m": 100,
    },
    "scaled for a central critic": {
        "auvs.start_cells": [[2, 1, 1], [1, 2, 1]],
        "training.critic": "central",
        "observation.kind": "scaled",
        "reward.credit": "difference",
    },
    "running scaler": {"training.observation_scaling": "running"},
}


@pytest.fixture(params=SCENARIOS.values(), ids=list(SCENARIOS))
def setup(request, tiny):
    return collector_of(tiny(request.param))


def collector_of(scenario, seed=4):
    collector = Collector([scenario], ENVS, [seed], Runtime())
    torch.manual_seed(0)
    world = collector.world
    network = make_network(world.observer, world.action_sizes, scenario.training)
    network.return_mean.fill_(-7.0)
    network.return_std.fill_(3.0)
    return collector, network


def collect(collector, network, slots, *, use_mask):
    """A rollout of a lone policy, without the axis of policies."""
    found = collector.collect(stacked([network]), slots, use_mask=use_mask)

    def alone(value):
        if isinstance(value, torch.Tensor) and value.ndim > 1:
            return value[:, 0]
        return {k: v[0] for k, v in value.items()} if isinstance(value, dict) else value

    kept = {field.name: alone(getattr(found, field.name)) for field in fields(found)}
    kept["episodes"] = [alone(episode) for episode in found.episodes]
    return replace(found, **kept)


def replay(scenario, rollouts, network, seed=4):
    """The same actions in a world of one's own: (seen, reward, seen next, ended).

    What is seen is what actor and critic get: observations, and the network's state.
    """
    world = World(scenario, ENVS, dtype="float32")
    rng = np.random.default_rng(seed)
    fixed = scenario.nodes.kind == "fixed"

    def start():
        return world.reset(node_codes(scenario, world.grid, [rng] * ENVS))

    def seen(state):
        everything = world.observer.observe_globally(state)[:, None, :].repeat(world.num_auvs, 1)
        for_critic = [everything, state.others_age, state.others_deliveries]
        if scenario.observation.kind == "scaled":
            for_critic[1] = for_critic[1] / scenario.age.maximum
            for_critic[2] = for_critic[2] / scenario.num_slots
        if scenario.reward.credit == "team":
            for_critic = for_critic[:1]
        return torch.from_numpy(world.observe(state)), torch.from_numpy(
            np.concatenate(for_critic, axis=-1)
        )

    state = start()
    for rollout in rollouts:
        rows = []
        for action in rollout.action.numpy():
            before = seen(state)
            state, events = world.step(state, action)
            reward = world.reward(state, events)
            after = seen(state)
            ended = bool(state.slot[0] == world.num_slots)
            rows.append((before, torch.from_numpy(reward), after, ended))
            if ended:
                state = world.reset(state.node_cell) if fixed else start()
        before, reward, after, ended = zip(*rows, strict=True)
        before, after = ([torch.stack(x) for x in zip(*s, strict=True)] for s in (before, after))
        yield rollout, before, torch.stack(reward), after, ended


def value(network, observation, for_critic):
    inputs = network.scaler(observation)
    if network.privileged is None:
        return network.value(inputs)
    return network.value(torch.cat([inputs, network.privileged(for_critic)], dim=-1))


@pytest.mark.slow
@pytest.mark.parametrize("slots", [[20, 20], [7, 7, 7, 7], [50], [1] * 25])
def test_equals_a_replay(setup, slots):
    collector, network = setup
    rollouts = [collect(collector, network, n, use_mask=False) for n in slots]
    replayed = replay(collector.world.scenario, rollouts, network)
    for rollout, (observation, state), reward, after, ended in replayed:
        if network.scaler.running:
            assert torch.equal(rollout.observation, observation)
        else:
            assert rollout.observation is None
        assert torch.equal(rollout.inputs, network.scaler(observation))
        torch.testing.assert_close(rollout.reward, reward, rtol=1e-6, atol=1e-6)
        assert rollout.truncated.tolist() == list(ended)
        with torch.no_grad():
            policy = network.log_probabilities(network.logits(network.scaler(observation)))
            expected = network.log_probability(policy, rollout.action)
            torch.testing.assert_close(rollout.log_probability, expected)
            torch.testing.assert_close(rollout.value, value(network, observation, state))
            # Of the state that followed, be it the last of its episode.
            torch.testing.assert_close(rollout.next_value, value(network, *after))


@pytest.mark.parametrize("kind", ["paper", "scaled"])
@pytest.mark.parametrize("central", [True, False])
def test_what_the_critic_sees_lies_within_its_ranges_and_uses_them(tiny, kind, central):
    changes = {"auvs.count": 2, "observation.kind": kind, "reward.credit": "difference"}
    collector, network = collector_of(tiny(changes))
    observer = collector.world.observer
    ranges = observer.critic_ranges(central=central)
    highest = np.zeros(len(ranges.low))
    for _ in range(collector.world.num_slots - 1):
        collect(collector, network, 1, use_mask=False)
        seen = observer.observe_for_critic(collector.state, central=central)
        assert (seen >= ranges.low).all()
        assert (seen <= ranges.high).all()
        highest = np.maximum(highest, (seen / ranges.scale).max((0, 1)))
    # Of ages and counts without this AUV, the last 2K entries, none is lost in the scale.
    num_nodes = collector.world.num_nodes
    assert (highest[-2 * num_nodes :] > 0.2).all()


@pytest.mark.parametrize(
    ("slots", "ends"),
    [
        (20, [[19], [19], [19]]),
        (7, [[], [], [5], [], [], [4]]),
        (50, [[19, 39], [9, 29, 49]]),
        (30, [[19], [9, 29]]),
    ],
)
def test_flags_tell_where_episodes_end_whatever_the_length_of_a_rollout(tiny, slots, ends):
    collector, network = collector_of(tiny())
    for expected in ends:
        rollout = collect(collector, network, slots, use_mask=False)
        assert [t for t, ended in enumerate(rollout.truncated) if ended] == expected
        assert len(rollout.episodes) == len(expected)


def test_next_value_of_a_last_slot_is_not_that_of_the_next_episode(tiny):
    collector, network = collector_of(tiny())
    rollout = collect(collector, network, 40, use_mask=False)
    assert not torch.allclose(rollout.next_value[19], rollout.value[20])
    assert torch.equal(rollout.next_value[18], rollout.value[19])


def test_layouts_are_drawn_anew_for_every_episode(tiny):
    collector, network = collector_of(tiny(RANDOM_NODES))
    rollout = collect(collector, network, 60, use_mask=False)
    nodes = rollout.inputs[..., -6:]
    assert torch.equal(nodes[0], nodes[19])
    assert not torch.equal(nodes[19], nodes[20])
    assert not torch.equal(nodes[0, 0], nodes[0, 1])


def test_metrics_are_those_of_whole_episodes(tiny):
    collector, network = collector_of(tiny({"training.observation_scaling": "running"}))
    first = collect(collector, network, 13, use_mask=False)
    second = collect(collector, network, 7, use_mask=False)
    assert first.episodes == []
    ages = torch.cat([first.observation, second.observation])[1:, ..., 3:5].mean((1, 2, 3))
    (metrics,) = second.episodes
    last = collector.world.scenario.num_slots
    whole = (ages.sum() + metrics["final_aoi"]) / last
    assert metrics["mean_aoi"] == pytest.approx(whole.item(), rel=1e-5)


def test_terms_of_the_reward_add_up(tiny):
    collector, network = collector_of(tiny({"reward.kind": "paper"}))
    rollout = collect(collector, network, 33, use_mask=False)
    assert len(rollout.reward_terms) > 1
    total = sum(rollout.reward_terms.values())
    assert total == pytest.approx(rollout.reward.mean().item(), rel=1e-5)


@pytest.mark.parametrize("changes", [{}, {"duplex.kind": "tdd"}], ids=["fdd", "tdd"])
def test_masked_actions_are_never_taken(tiny, changes):
    collector, network = collector_of(tiny(changes))
    rollout = collect(collector, network, 60, use_mask=True)
    masks = rollout.mask.split(collector.world.action_sizes, dim=-1)
    assert not masks[0].all(), "the mask forbids nothing"
    for mask, choice in zip(masks, rollout.action.unbind(-1), strict=True):
        assert mask.gather(-1, choice[..., None]).all()
    with torch.no_grad():
        policy = network.log_probabilities(network.logits(rollout.inputs, rollout.mask))
    expected = network.log_probability(policy, rollout.action)
    torch.testing.assert_close(rollout.log_probability, expected)


def test_actions_are_samples_of_the_policy(tiny):
    collector, network = collector_of(tiny())
    rollout = collect(collector, network, 400, use_mask=False)
    direction = np.bincount(rollout.action[..., 0].flatten().numpy(), minlength=6)
    assert (direction > 0.1 * direction.sum()).all()


def test_collector_continues_from_its_state(tiny):
    whole, network = collector_of(tiny(RANDOM_NODES))
    collect(whole, network, 13, use_mask=False)
    other, _ = collector_of(tiny(RANDOM_NODES), seed=99)
    other.load_state_dict([whole.state_dict()])
    for slots in (13, 13):
        first = collect(whole, network, slots, use_mask=False)
        second = collect(other, network, slots, use_mask=False)
        assert torch.equal(first.inputs, second.inputs)
        assert torch.equal(first.action, second.action)


def test_state_is_a_snapshot(tiny):
    collector, network = collector_of(tiny())
    saved = collector.state_dict()
    before = {k: v.clone() for k, v in saved["state"].items()}
    collect(collector, network, 13, use_mask=False)
    assert all(torch.equal(saved["state"][k], v) for k, v in before.items())
    # What a scenario has no use for is left out: here users' metrics, which alone are summed over
    # slots, limits of stores and vehicles, nobody to name, nodes polled, moves that take several
    # slots, and a sea that changes.
    unused = {"sums", "unasked", "polled", *STORE_FIELDS, *VEHICLE_FIELDS, *TRANSIT_FIELDS}
    unused |= set(SEA_FIELDS)
    assert set(before) == set(State._fields) - unused
