"""A sea that changes from slot to slot, and packets that get lost in it."""

import copy
import pickle

import numpy as np
import pytest
import torch
from batteries import BATTERY
from seas import ERRORS, POLLED, ROUGH, TDD, TWO

from iout_marl import World, evaluate, load_scenario, pretrained
from iout_marl.envs.joint import AUVEnv
from iout_marl.envs.vector import AUVVectorEnv
from iout_marl.errors import Note, warn_once
from iout_marl.physics.packets import bpsk_bit_error_rate, packet_error_rate
from iout_marl.policies import GuidedBeam
from iout_marl.replay import record_policy
from iout_marl.testing.recorded import actions_for, chance_for, first_state
from iout_marl.world import has_chance

SEAS = {"fdd": ROUGH, "polled": POLLED, "tdd": TDD, "two": {**POLLED, **TWO}}
#: Without anything that changes but what is drawn for each packet.
BITS = {**ROUGH, "channel.fading": "none", "channel.wind": "steady", "uplink.margin_db": 0.0}


def rough(overrides):
    return load_scenario("paper/k3-fdd", overrides)


def played(world, seed, slots=None):
    """States and events of an episode by random actions."""
    seeds = [seed + i for i in range(world.num_envs)]
    state, chance = first_state(world, seeds), chance_for(world, seeds)
    for action in actions_for(world, seed)[:slots]:
        before = state
        state, events = world.step(before, world.backend.integers(action), next(chance))
        yield before, events, state


def test_shadowing_is_as_spread_in_every_slot_and_forgets():
    world = World(rough(ROUGH), 2000)
    gains = [state.gain_db for *_, state in played(world, 0, 12)]
    sigma = 3.0
    for gain in gains:
        assert gain.shape == (2000, 1, 3)
        assert abs(gain.mean()) < 5 * sigma / np.sqrt(gain.size)
        assert gain.std() == pytest.approx(sigma, rel=0.04)
    for lag in (1, 5, 10):
        found = np.mean(gains[0] * gains[lag]) / sigma**2
        expected = np.exp(-lag * world.link.slot_s / 600)
        assert found == pytest.approx(expected, abs=0.06)
    apart = np.corrcoef(gains[0][:, 0].T)[np.triu_indices(3, 1)]
    assert np.abs(apart).max() < 0.08  # links have nothing in common


def test_gusts_do_not_make_wind_less_than_none():
    scenario = rough({**ROUGH, "channel.wind_m_per_s": 1.0})
    world = World(scenario, 500)
    state = [state for *_, state in played(world, 0, 5)][-1]
    assert (state.gust_m_per_s < -1).any()
    noise = world.reception.conditions(state, next(world.draw_chance(0))).noise_db
    calm = scenario.channel.part.noise_above_mean_db(
        np.zeros(1), world.link.budget.uplink_frequency_khz, world.link.budget.bandwidth_hz
    )
    assert noise.min() == pytest.approx(calm[0])


def test_harvests_rise_with_the_level_and_never_above_the_law():
    world = World(rough(ROUGH), 200)
    seen_nothing = False
    for before, events, after in played(world, 3):
        charged = events.charged[:, 0]
        gain_db = np.take_along_axis(after.gain_db[:, 0], charged[:, None], 1)[:, 0]
        node_cell = before.node_cell[np.arange(200), charged]
        loss_db = world.link.charging_loss_db[world.link.offset(after.cell[:, 0], node_cell)]
        law_w = world.link.budget.harvested_after_loss_w(loss_db - gain_db)
        found_w = events.harvested_j[:, 0] / world.link.slot_s
        assert (found_w <= law_w * (1 + 1e-12)).all()
        near_w = world.link.budget.harvested_after_loss_w(loss_db - gain_db + 0.0011)
        assert (found_w >= near_w * (1 - 1e-12)).all()
        seen_nothing |= bool((law_w == 0).any())
    assert seen_nothing  # the rectifier's threshold counts


def test_packets_get_lost_as_often_as_bit_errors_have_it():
    world = World(rough(BITS), 3000)
    sent = lost = 0
    for _, events, _ in played(world, 0):
        sent += int((events.spent_j > 0).sum())
        lost += int(events.lost.sum())
    own = world.scenario.uplink
    ratio_db = own.required_snr_db + 10 * np.log10(own.bandwidth_hz / own.bit_rate_bps)
    share = float(packet_error_rate(own.packet_bits, bpsk_bit_error_rate(ratio_db)))
    assert sent > 2000
    assert abs(lost / sent - share) < 4 * np.sqrt(share * (1 - share) / sent)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["fdd", "polled"])
@pytest.mark.parametrize("sampling", ["slot_end", "packet_start"])
def test_what_is_expected_is_the_mean_of_what_is_drawn(name, sampling):
    """Ages and deliveries of one slot are linear in whether packets arrive."""
    hearing = {"hearing": POLLED["hearing"]} if name == "polled" else {}
    scenario = rough({**BITS, **hearing, "age.sampling": sampling, "uplink.required_snr_db": 5.5})
    one, many = World(scenario), World(scenario, 20_000)
    state = one.reset()
    state = state._replace(
        age=state.age + np.array([[4.0, 8.0, 2.0]]), energy_j=state.energy_j + 90.0
    )
    action = np.array([[[6, 0, 1]]]) % np.array(one.action_sizes)
    expected, events = one.step(state, action, one.expected)
    copies = state.map(lambda array: np.repeat(array, 20_000, axis=0))
    drawn, _ = many.step(copies, np.repeat(action, 20_000, axis=0), next(many.draw_chance(5)))
    assert 0 < expected.deliveries[0].max() < 1
    for field in ("age", "deliveries", "packets"):
        mean, spread = (f(getattr(drawn, field), axis=0) for f in (np.mean, np.std))
        gap = np.abs(mean - getattr(expected, field)[0])
        assert (gap <= 5 * spread / np.sqrt(20_000) + 1e-9).all(), field
    assert events.delivered[0, 0] == (expected.deliveries[0, 1] > 0.5)


def test_lost_packets_cost_their_energy_and_are_told_apart():
    scenario = rough(SEAS["two"])
    world = World(scenario, 300)
    codes = set()
    for before, events, after in played(world, 1):
        lost = events.lost
        assert not (lost[..., 0] & events.delivered).any()
        assert not (lost[..., 1:] & events.polled_delivered).any()
        assert (events.spent_j[lost[..., 0]] > 0).all()
        assert (events.polled_j[lost[..., 1:]] > 0).all()
        delivered = events.delivered.sum(axis=1) + events.polled_delivered.sum(axis=(1, 2))
        assert (delivered == (after.deliveries - before.deliveries).sum(axis=1)).all()
        for row in world.outcomes(before, events, after):
            codes |= {reason.code for reason in row if reason}
        for row in world.polled_outcomes(before, events, after):
            codes |= {reason.code for auv in row for reason in auv if reason}
        assert (after.packets[:, 1:].sum(axis=1) <= after.packets[:, 0]).all()
    assert {"too_weak", "bit_errors"} <= codes
    assert "not_stated" not in codes
    found = world.metrics(after)
    weak, bits = (found[f"packets_lost_{cause}"] for cause in ("weak", "bits"))
    np.testing.assert_allclose(found["packets_lost"], weak + bits)
    np.testing.assert_array_equal(found["packets_sent"], after.packets[:, 0])


def test_an_auv_that_polls_goes_on_after_a_lost_packet():
    scenario = rough({**POLLED, "charging.power_w": 2000})
    world, went_on = World(scenario, 200), 0
    for _, events, _ in played(world, 2):
        went_on += int((events.lost[..., 0] & (events.polled[..., 1] < world.num_nodes)).sum())
    assert went_on > 0


def test_a_threshold_leaves_nothing_to_chance():
    still = {"channel.fading": "none", "channel.wind": "steady", "uplink.loss": "threshold"}
    scenario = rough({**ROUGH, **still})
    assert not has_chance(scenario)
    world = World(scenario, 2)
    assert (world.chance, world.expected) == ({}, None)
    for _, events, _ in played(world, 0):
        assert not events.lost.any()  # what a packet needs, it has
    assert has_chance(rough({**ROUGH, **still, "channel.fading": ROUGH["channel"]["fading"]}))


def test_wind_is_left_alone_where_nothing_gets_lost():
    scenario = rough({**ROUGH, "uplink.loss": "none", "channel.fading": "none"})
    assert World(scenario).chance == {}
    assert not has_chance(scenario)


@pytest.mark.slow
@pytest.mark.parametrize("name", SEAS)
def test_environments_of_a_batch_are_those_alone(name):
    scenario, seeds = rough(SEAS[name]), (4, 5, 6)
    envs = AUVVectorEnv(scenario, 3)
    singles = [AUVEnv(scenario) for _ in seeds]
    envs.reset(seed=4)
    for env, seed in zip(singles, seeds, strict=True):
        env.reset(seed=seed)
    envs.action_space.seed(0)
    rewards = 0.0
    for _ in range(2 * envs.episodes.world.num_slots):
        actions = envs.action_space.sample()
        seen, reward, *_, infos = envs.step(actions)
        for i, env in enumerate(singles):
            own, own_reward, _, over, own_info = env.step(actions[i])
            if over:
                own, own_info = env.reset()
            np.testing.assert_array_equal(own, seen[i])
            assert own_reward == pytest.approx(reward[i], abs=1e-9)
            assert own_info["delivered"] == pytest.approx(infos["delivered"][i])
        rewards += reward
    assert len(set(rewards)) == 3


def test_copies_go_on_alike():
    envs = AUVVectorEnv(rough(ROUGH), 2)
    envs.reset(seed=0)
    envs.action_space.seed(0)
    envs.step(envs.action_space.sample())
    twins = [copy.deepcopy(envs), pickle.loads(pickle.dumps(envs))]
    for _ in range(60):  # into the next episode
        actions = envs.action_space.sample()
        expected = envs.step(actions)
        for twin in twins:
            for mine, theirs in zip(twin.step(actions)[:3], expected[:3], strict=True):
                np.testing.assert_array_equal(mine, theirs)


def test_float32_on_torch_plays_the_same_world():
    scenario = rough(SEAS["two"])
    ours, theirs = World(scenario, 4), World(scenario, 4, torch, "float32")
    for (_, events, state), (_, other, after) in zip(
        played(ours, 0), played(theirs, 0), strict=True
    ):
        np.testing.assert_allclose(after.gain_db, state.gain_db, atol=1e-4)
        np.testing.assert_array_equal(other.delivered, events.delivered)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::iout_marl.errors.Note")
@pytest.mark.parametrize("policy", ["greedy", "tour", "planner", "random-walk", "return"])
def test_policies_play_it(policy):
    limits = {"vehicle": {**BATTERY, "docks": [[1, 1, 1]], "dock_power_w": 2000.0}}
    scenario = rough({**ROUGH, **(limits if policy == "return" else {})})
    found = evaluate(scenario, policy, 4)
    assert not found.deterministic
    assert found.episodes == 4
    assert len(set(found.samples["packets_lost"])) > 1


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::iout_marl.errors.Note")
@pytest.mark.parametrize("make", [lambda: "tour", lambda: GuidedBeam(pretrained(), 1)])
def test_plans_are_made_once_and_kept(make):
    first, second = (record_policy(rough(ROUGH), make(), seed) for seed in (0, 7))
    for name in ("charged", "heard", "path"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    assert (first.outcome != second.outcome).any()


def test_that_plans_are_for_what_is_expected_is_told_once():
    warn_once.cache_clear()
    with pytest.warns(Note, match="plan for the median sea and expected deliveries"):
        evaluate(rough(ROUGH), "tour", 2)
    evaluate(rough(ROUGH), "tour", 2)


def test_recordings_say_why_packets_were_lost():
    recording = record_policy(rough({**ROUGH, "charging.power_w": 2000}), "greedy", 3)
    assert {"too_weak", "bit_errors"} & {reason.code for reason in recording.reasons}


def test_a_table_of_losses_is_read_between_its_lines():
    scenario = rough({**BITS, "uplink.loss": {"kind": "table", "file": ERRORS}})
    ratio_db = np.array([-5.0, 0.0, 5.0, 10.0, 15.0, 90.0])
    found = scenario.uplink.part.loss.packet_error_rate(ratio_db, scenario.uplink.part)
    np.testing.assert_allclose(found, [1, 1, 0.65, 0.3, 0.175, 0.05])
