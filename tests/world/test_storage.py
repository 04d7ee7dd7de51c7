"""Stores with limits: energy is conserved, nothing is sent that they cannot pay, all play alike."""

import random

import numpy as np
import pytest
import torch
from oracle import Oracle
from oracle_episodes import biased_action

from iout_marl import World, evaluate, iout_v0, load_scenario, parts
from iout_marl.envs import AUVEnv, AUVVectorEnv
from iout_marl.testing import check_vector_env
from iout_marl.world import node_codes
from trainers import Trainer

CAPACITOR = {
    "kind": "capacitor",
    "capacity_j": 300.0,
    "initial_j": 40.0,
    "leakage_w": 0.15,
    "idle_w": 0.35,
}
TEAM = {"auvs.start_cells": [[5, 5, 2], [1, 2, 1], [3, 1, 2]]}
ONE_BAND = {"channel.access": "interference", **TEAM}
WORLDS = {
    "fdd": ("paper/k5-fdd", {}),
    "tdd": ("paper/k5-tdd", {}),
    "tdd-stored": ("best/k5-tdd", {}),
    "fdd-team": ("paper/k5-fdd", ONE_BAND),
    "tdd-team": ("paper/k5-tdd", TEAM),
    "tdd-stored-team": ("best/k5-tdd", ONE_BAND),
}
STORES = {
    "as it is": {},
    "tiny": {"capacity_j": 110.0},
    "without loss": {"leakage_w": 0.0, "idle_w": 0.0},
    "only leaking": {"idle_w": 0.0, "leakage_w": 2.0},
    "hungry": {"idle_w": 5.0},
}


def make(case, store=(), num_envs=4, **options):
    name, changes = WORLDS[case]
    storage = {**CAPACITOR, **dict(store)}
    return World(load_scenario(name, {**changes, "storage": storage}), num_envs, **options)


def slots(world, seed=0):
    """States before and after slots of one node each half the time, and what happened in them."""
    rng, state = np.random.default_rng(seed), world.reset(seed=seed)
    shape = world.num_envs, world.num_auvs
    for slot in range(world.num_slots):
        action = np.stack([rng.integers(0, n, shape) for n in world.action_sizes], -1)
        together = rng.random((*shape, 1)) < 0.5
        action[..., 1:] = np.where(together, slot // 15 % world.num_nodes, action[..., 1:])
        before = state
        state, events = world.step(before, action)
        yield before, events, state


@pytest.mark.slow
@pytest.mark.parametrize("store", STORES)
@pytest.mark.parametrize("case", WORLDS)
def test_energy_is_conserved_to_the_joule_of_every_node_and_in_total(case, store):
    world = make(case, STORES[store])
    harvested_j, spent_j = np.zeros((2, world.num_envs, world.num_nodes))
    env = np.arange(world.num_envs)[:, None]
    for _, events, after in slots(world):
        np.add.at(harvested_j, (env, events.charged), events.harvested_j)
        np.add.at(spent_j, (env, events.heard), events.spent_j)
        assert (after.energy_j >= 0).all()
        assert (events.available_j <= CAPACITOR["capacity_j"]).all()
    initial_j = world.storage.initial_j
    gone_j = spent_j + after.idle_j + after.leaked_j + after.spilled_j
    assert np.abs(initial_j + harvested_j - after.energy_j - gone_j).max() < 1e-6
    total_j = after.spent_j + sum(
        array.sum(-1) for array in (after.energy_j, after.idle_j, after.leaked_j, after.spilled_j)
    )
    come_j = initial_j * world.num_nodes + after.harvested_j
    assert np.abs(come_j - total_j).max() < 1e-6
    # What is shared, is shared in the proportion of what is asked for.
    ask = world.scenario.storage
    assert np.allclose(after.leaked_j * ask.idle_w, after.idle_j * ask.leakage_w, atol=1e-6)
    assert (after.spilled_j.sum() > 0) or store in ("only leaking", "hungry")
    assert spent_j.sum() > 0


@pytest.mark.slow
@pytest.mark.parametrize("store", ["as it is", "tiny", "hungry"])
@pytest.mark.parametrize("case", WORLDS)
def test_nothing_is_spent_that_is_not_there(case, store):
    """Beyond rounding: where β follows from stored and harvested energy, too."""
    world = make(case, STORES[store])
    env, delivered = np.arange(world.num_envs)[:, None], 0
    for _, events, _ in slots(world):
        available_j = events.available_j[env, events.heard]
        assert (events.spent_j <= available_j * (1 + 1e-9)).all()
        delivered += events.delivered.sum()
    assert delivered > 0


class Careless(parts.duplexes["fdd"].item):
    """Has every node send, whatever it has."""

    def sends(self, split, available_j):
        return split.required_j >= 0 * available_j


def test_a_duplex_part_that_forgets_to_ask_is_held_to_what_a_full_store_has():
    world = make("fdd", {"capacity_j": 25.0, "initial_j": 0.0})
    careless = Careless(world.scenario.duplex)
    careless.setup(world.duplex.world)
    world.duplex = careless
    found = set()
    for before, events, after in slots(world):
        node = (np.arange(world.num_envs)[:, None], events.heard)
        is_full = events.available_j[node] == 25
        charged_j = np.where(events.charged == events.heard, events.harvested_j, 0)
        spilled = is_full & (before.energy_j[node] + charged_j > 25)
        split = world.duplex.split(*[world.link.offset(after.cell, after.node_cell[node])] * 2, 0)
        assert not (events.delivered & spilled & (split.required_j > 25)).any()
        assert not (events.delivered & (events.available_j[node] == 0)).any()
        found |= {r.code for row in world.outcomes(before, events, after) for r in row if r}
    assert found == {"asleep", "store_too_small"}


def test_a_node_without_its_idle_draw_sleeps_until_it_is_charged_and_ages():
    world = make("fdd", {"initial_j": 10.0}, 1)  # idle draw and leakage: 12.5 J a slot
    state, ages, slept = world.reset(), [], []
    for slot in range(6):
        charged, heard = (3, 0) if slot < 4 else (0, 0)
        before = state
        state, events = world.step(state, np.array([[[0, charged, heard]]]))
        reason = world.outcomes(before, events, state)[0][0]
        slept.append(reason is not None and reason.code == "asleep")
        ages.append(float(state.age[0, 0]))
    # In the first slot it still has 10 J, too little for its draw.
    assert slept == [False, True, True, True, False, False]
    assert ages[:4] == [2, 3, 4, 5]
    assert state.asleep_slots[0, 0] == 3
    assert state.idle_j[0, 0] > 7.0
    assert state.leaked_j[0, 0] > 3.0


def test_of_a_store_without_idle_draw_no_node_sleeps():
    *_, (_, _, after) = slots(make("fdd", {"idle_w": 0.0, "leakage_w": 5.0}))
    assert after.asleep_slots.sum() == 0
    assert after.leaked_j.sum() > 0


def test_stores_without_limits_add_nothing():
    """No operation, no column of a state, no metric."""
    world = World("paper/k5-fdd")
    state = world.reset()
    assert world.storage.filled(state.energy_j) is state.energy_j
    after = world.storage.after(state, None, None, state.energy_j)
    assert after["energy_j"] is state.energy_j
    assert all(after[name] is getattr(state, name) for name in after)
    assert state.spilled_j.shape == (1, 0)
    assert "spilled_j" not in world.metrics(state)


@pytest.mark.slow
def test_a_capacitor_that_neither_fills_nor_loses_is_a_store_without_limits():
    large = {"kind": "capacitor", "capacity_j": 1e9}
    for name, changes in WORLDS.values():
        plain, limited = (
            World(load_scenario(name, changes | more), 2) for more in ({}, {"storage": large})
        )
        for one, other in zip(slots(plain), slots(limited), strict=True):
            assert np.array_equal(one[2].energy_j, other[2].energy_j)
            assert np.array_equal(one[1].delivered, other[1].delivered)
            assert np.array_equal(plain.action_mask(one[2]), limited.action_mask(other[2]))


@pytest.mark.slow
@pytest.mark.parametrize("case", ["fdd", "tdd-stored", "fdd-team"])
def test_torch_and_single_environments_agree(case):
    world, theirs = make(case), make(case, library=torch)
    env = iout_v0.parallel_env(world.scenario)
    env.reset(seed=0)
    state, other = world.reset(seed=0), theirs.reset(seed=0)
    rng = np.random.default_rng(1)
    for _ in range(40):
        shape = (world.num_envs, world.num_auvs)
        action = np.stack([rng.integers(0, n, shape) for n in world.action_sizes], -1)
        state, _ = world.step(state, action)
        other, _ = theirs.step(other, torch.as_tensor(action))
        seen, *_ = env.step(dict(zip(env.possible_agents, action[0], strict=True)))
        ours = world.observe(state)[0].astype(np.float32)
        assert np.allclose(np.stack(list(seen.values())), ours, rtol=1e-6)
    for name in ("energy_j", "spilled_j", "leaked_j", "idle_j", "asleep_slots"):
        assert np.allclose(getattr(other, name).numpy(), getattr(state, name), rtol=1e-12)


@pytest.mark.parametrize("case", ["fdd", "fdd-team"])
def test_masked_nodes_could_not_have_paid(case):
    """The mask leaves out only what no move and no charging could have had delivered."""
    world = make(case, {"capacity_j": 150.0})
    masked = 0
    for before, events, _ in slots(world):
        mask = world.action_mask(before)
        hears = mask[..., -world.num_nodes :]
        allowed = np.take_along_axis(hears, events.heard[..., None], -1)[..., 0]
        assert not (events.delivered & ~allowed).any()
        masked += (~hears).sum()
    assert masked > 0


@pytest.mark.slow
@pytest.mark.parametrize("policy", ["greedy", "tour", "planner"])
@pytest.mark.parametrize("duplex", ["fdd", "tdd"])
def test_policies_play(tiny, policy, duplex):
    storage = {**CAPACITOR, "initial_j": 0.0, "idle_w": 0.01, "leakage_w": 0.0}
    found = evaluate(tiny({"storage": storage}, f"paper/k3-{duplex}"), policy, 1)
    assert found.metrics["mean_aoi"].mean > 0
    assert found.metrics["uplink_success"].mean > 0


@pytest.mark.parametrize("duplex", ["fdd", "tdd"])
def test_the_batched_environment_does_what_single_ones_do_resets_of_some_included(tiny, duplex):
    limited = tiny({"storage": CAPACITOR}, f"paper/k3-{duplex}")
    check_vector_env(lambda: AUVVectorEnv(limited, 3), lambda: AUVEnv(limited), seeds=(7,))


def test_trainings_go_on_where_they_were(tiny):
    scenario = tiny({"storage": CAPACITOR})
    trainer = Trainer(scenario)
    log = trainer.iterate()
    assert log["energy/idle_j"] > 0
    saved = trainer.collector.state_dict()
    assert saved["state"]["spilled_j"].shape == saved["state"]["age"].shape
    other = Trainer(scenario)
    other.collector.load_state_dict([saved])
    assert np.array_equal(other.collector.state.idle_j, trainer.collector.state.idle_j)


def test_without_limits_a_training_keeps_what_it_kept_before(tiny):
    trainer = Trainer(tiny())
    trainer.iterate()
    saved = trainer.collector.state_dict()
    assert not {"spilled_j", "leaked_j", "idle_j", "asleep_slots"} & saved["state"].keys()
    trainer.collector.load_state_dict([saved])
    assert trainer.collector.state.spilled_j.shape[-1] == 0


@pytest.mark.parametrize("case", ["fdd-team", "tdd-stored-team"])
def test_the_breakdown_is_that_of_the_oracle(case):
    """Of single nodes over a whole episode, with energy from several AUVs at once."""
    world = make(case, num_envs=1)
    scenario, rng = world.scenario, random.Random(3)
    oracle = Oracle(scenario, scenario.nodes.cells[: scenario.num_nodes])
    state = world.reset(node_codes(scenario, world.grid, [np.random.default_rng(0)]))
    for _ in range(world.num_slots):
        action = biased_action(rng, 2, oracle)
        oracle.step(action)
        state, _ = world.step(state, np.array([action]))
    stores = oracle.stores
    for name in ("spilled_j", "leaked_j", "idle_j", "asleep_slots"):
        assert np.allclose(getattr(state, name)[0], getattr(stores, name), rtol=1e-9, atol=1e-9)
    in_j = stores.initial_j * len(oracle.nodes) + oracle.harvested_j
    out_j = oracle.spent_j + sum(map(sum, (stores.spilled_j, stores.leaked_j, stores.idle_j)))
    assert in_j == pytest.approx(out_j + sum(oracle.energy_j), abs=1e-6)
