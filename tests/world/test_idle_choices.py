"""AUVs that name nobody: what they leave alone, and who says so."""

import numpy as np
import pytest
import torch

from iout_marl import World, evaluate, load_scenario
from iout_marl.breakdown import Tally
from iout_marl.core.reasons import NOBODY_ASKED

NOBODY = {"auvs.idle_choices": True}
STARTS = [[5, 5, 2], [1, 2, 1], [9, 9, 4]]
ACCESS = ("orthogonal", "interference", "exclusive")
WORLDS = ("paper/k5-fdd", "best/k5-tdd")
every_world = pytest.mark.parametrize("name", WORLDS)


def world_of(name, auvs=1, envs=1, library=np, **changes):
    settings = {"auvs.start_cells": STARTS[:auvs], "auvs.separation_cells": 0, **NOBODY}
    return World(name, envs, library, overrides=settings | changes)


def draw(world, seed=0):
    """(slots, envs, auvs, entries) actions, a third of whose choices are nobody."""
    rng = np.random.default_rng(seed)
    shape = (world.num_slots, world.num_envs, world.num_auvs)
    actions = np.stack([rng.integers(0, n, shape) for n in world.action_sizes], axis=-1)
    idle = rng.random(actions[..., 1:].shape) < 1 / 3
    actions[..., 1:][idle] = world.num_nodes
    return actions


def play(world, actions):
    state = world.reset()
    for action in actions:
        before = state
        state, events = world.step(before, world.backend.integers(action))
        yield before, events, state


@every_world
def test_there_is_one_more_choice_and_the_hash_counts_it(name):
    plain, world = World(name), world_of(name)
    assert world.action_sizes == (6, *(n + 1 for n in plain.action_sizes[1:]))
    assert load_scenario(name, {"auvs.idle_choices": False}).hash == load_scenario(name).hash
    assert load_scenario(name, NOBODY).world_hash != load_scenario(name).world_hash


@every_world
def test_without_it_k_is_refused_and_with_it_what_comes_after(name):
    plain, world = World(name), world_of(name)
    entries = len(world.action_sizes) - 1
    with pytest.raises(ValueError, match=r"lies outside MultiDiscrete\(\[6, 5"):
        plain.checked_step(plain.reset(), [[[0, *[5] * entries]]])
    world.checked_step(world.reset(), [[[0, *[5] * entries]]])
    with pytest.raises(ValueError, match=r"lies outside MultiDiscrete\(\[6, 6"):
        world.checked_step(world.reset(), [[[0, *[6] * entries]]])


@every_world
def test_an_idle_slot_costs_and_brings_nothing(name):
    world = world_of(name)
    actions = draw(world)
    for slot, (before, events, after) in enumerate(play(world, actions)):
        charges, hears = (n[0, 0] < world.num_nodes for n in (events.charged, events.heard))
        if not charges:
            assert events.harvested_j == 0
            assert events.beta == 0
        if not hears:
            assert events.spent_j == 0
            assert not events.delivered
            assert world.outcomes(before, events, after) == [[NOBODY_ASKED]]
            assert world.reward_terms(after, events).get("information", 0) == 0
        if not (charges or hears):
            assert np.array_equal(after.energy_j, before.energy_j), slot


@pytest.mark.slow
@every_world
@pytest.mark.parametrize("access", ACCESS)
def test_an_auv_that_names_nobody_changes_nothing_for_others(name, access):
    """Nor where it goes, nor, where the band is not divided by AUVs, that it is there at all."""
    changes = {"channel.access": access, "uplink.packet_bits": 5000, "charging.power_w": 40000}
    three = world_of(name, 3, **changes)
    actions = draw(three)
    actions[:, :, 2, 1:] = three.num_nodes
    elsewhere = actions.copy()
    elsewhere[:, :, 2, 0] = (elsewhere[:, :, 2, 0] + 1) % 6
    others = [play(three, elsewhere)]
    if access != "orthogonal":
        others.append(play(world_of(name, 2, **changes), actions[:, :, :2]))
    arrived = 0
    expected = list(play(three, actions))
    for found in others:
        for (_, events, state), (_, its_events, its_state) in zip(expected, found, strict=True):
            for field in ("age", "deliveries"):
                assert np.array_equal(getattr(state, field), getattr(its_state, field))
            np.testing.assert_allclose(state.energy_j, its_state.energy_j, 1e-12)
            assert np.array_equal(events.delivered[:, :2], its_events.delivered[:, :2])
            np.testing.assert_allclose(events.beta[:, :2], its_events.beta[:, :2], 1e-12)
            arrived += events.delivered.sum()
    assert arrived > 0


@pytest.mark.slow
@every_world
@pytest.mark.parametrize("access", ACCESS)
def test_a_batch_is_its_environments_on_any_library(name, access):
    changes = {"channel.access": access, "observation.view_range_m": 300}
    batch, tensors = (world_of(name, 3, 4, library, **changes) for library in (np, torch))
    actions = draw(batch)
    alone = [play(world_of(name, 3, **changes), actions[:, i : i + 1]) for i in range(4)]
    for together, on_torch, *singles in zip(
        play(batch, actions), play(tensors, actions), *alone, strict=True
    ):
        for result in (1, 2):  # events, and the state after
            fields = together[result]._asdict()
            for field, values in fields.items():
                found = getattr(on_torch[result], field)
                np.testing.assert_allclose(np.asarray(found), values, 1e-9, 1e-9, err_msg=field)
                for env, single in enumerate(singles):
                    own = getattr(single[result], field)
                    np.testing.assert_allclose(own[0], values[env], 1e-9, 1e-9, err_msg=field)


@every_world
def test_its_mask_always_allows_nobody(name):
    world = world_of(name, 2, **{"charging.power_w": 1e-3})
    lasts = np.cumsum(world.action_sizes)[1:] - 1
    hidden = 0
    for _, _, state in play(world, draw(world)):
        mask = world.action_mask(state)
        assert mask.shape[-1] == sum(world.action_sizes)
        assert mask[..., lasts].all()
        hidden += (~mask[..., 6:]).sum()
    # In FDD no node can ever pay: nobody is the one choice to hear.
    assert (hidden > 0) == (len(lasts) == 2)


@every_world
def test_success_is_of_what_was_asked(name):
    world = world_of(name, 3)
    asked = arrived = 0
    for _, events, state in play(world, draw(world)):
        asked += (events.heard < world.num_nodes).sum()
        arrived += events.delivered.sum()
        assert world.metrics(state)["uplink_success"] == pytest.approx(arrived / max(asked, 1))
    assert 0 < arrived < asked < world.num_slots * 3


class Idle:
    """Stays away from everybody."""

    name = "idle"

    def act(self, world, state, rng):
        action = np.zeros((*state.cell.shape, len(world.action_sizes)), dtype=np.int64)
        action[..., 1:] = world.num_nodes
        return action


@every_world
def test_who_asks_nobody_succeeds_in_nothing(name):
    found = evaluate(load_scenario(name, NOBODY), Idle(), 1).metrics
    for metric in ("uplink_success", "harvested_kj", "spent_kj", "jain"):
        assert found[metric].mean == 0, metric


@every_world
def test_the_breakdown_adds_up(name):
    world = world_of(name, 3)
    tally = Tally(world, world.reset())
    for _, events, state in play(world, draw(world)):
        tally.add(state, events)
    found = tally.result(state)
    assert found.nodes["harvested_j"].sum() == pytest.approx(state.harvested_j[0])
    assert found.nodes["spent_j"].sum() == pytest.approx(state.spent_j[0])
    left_j = found.nodes["harvested_j"] - found.nodes["spent_j"]
    np.testing.assert_allclose(left_j, found.nodes["left_j"], atol=1e-6)
    assert found.auvs["packets"].sum() == found.nodes["deliveries"].sum()
