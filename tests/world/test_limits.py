"""What no sea knows: the world holds its numbers, without a warning, or says why it cannot."""

import itertools

import numpy as np
import pytest

from iout_marl.errors import InputError
from iout_marl.policies import make_baseline
from iout_marl.scenario import Scenario, load_scenario
from iout_marl.scenario.keys import ranges_of
from iout_marl.tracing.unrolled import UnrolledSlot, numbers
from iout_marl.world import World, node_codes

TEAM = {"auvs.start_cells": [[5, 5, 2], [1, 1, 1], [9, 9, 4]]}
SONAR = {"channel": {"kind": "sonar", "access": "interference"}}
#: By duplex: settings that a scenario may list as implausible, and more.
HELD = {
    "hertz for kilohertz": ("fdd", {"duplex.uplink_frequency_khz": 30_000.0}),
    "hertz for kilohertz in both bands": (
        "fdd",
        {"duplex.uplink_frequency_khz": 30_000.0, "duplex.charging_frequency_khz": 40_000.0},
    ),
    "hertz for kilohertz in TDD": ("tdd", {"duplex.frequency_khz": 40_000.0}),
    "megahertz by the million": ("tdd", {"duplex.frequency_khz": 1e15}),
    "a wide sea": ("fdd", {"grid.spacing_m": 1e6, "episode.duration_s": 2.5e7}),
    "a wide sea in TDD": ("tdd", {"grid.spacing_m": 1e6, "episode.duration_s": 2.5e7}),
    "cells like needles": (
        "fdd",
        {
            "grid.spacing_m": [1e-6, 1e6, 3],
            "grid.own_cell_distance": "mean",
            "episode.duration_s": 2.5e7,
        },
    ),
    "a directivity of 300 dB": (
        "fdd",
        SONAR | TEAM | {"channel.uplink_directivity_index_db": 300.0},
    ),
    "a directivity of -300 dB": (
        "tdd",
        SONAR | TEAM | {"channel.uplink_directivity_index_db": -300.0},
    ),
    "a deafening noise": ("fdd", TEAM | {"channel.noise_level_db": 300.0}),
    "a noise below all": ("tdd", TEAM | {"channel.noise_level_db": -200.0}),
    "a harvester of the wrong sign": ("fdd", {"harvester.sensitivity_db": 150.0}),
    "a harvester that hears nothing": ("fdd", {"harvester.sensitivity_db": -300.0}),
    "a packet beyond all bands": ("fdd", {"uplink.packet_bits": 1e12}),
    "a packet beyond all bands in TDD": (
        "tdd",
        {"uplink.packet_bits": 1e12, "duplex.beta_rule": "stored"},
    ),
    "hardly a packet": ("tdd", {"uplink.packet_bits": 1e-9, "observation.kind": "scaled"}),
    "a view without an end": ("fdd", {"observation.view_range_m": 1e15}),
    "ages without an end": ("fdd", {"age.maximum": 10**12}),
    "weights of millions": ("fdd", {"nodes.weights": [1e9, 1e9, 1e9]}),
    "disturbed by charging": (
        "tdd",
        TEAM
        | {
            "channel.access": "interference",
            "charging.power_w": 1e9,
            "channel.noise_level_db": -100.0,
        },
    ),
}
LONG = {"episode.duration_s": 2.5e6}
#: By the key that is named: what a scenario may say, but no world can hold.
REFUSED = {
    "nodes.weights": {"nodes.weights": [1e15, 1e15, 1e15]},
    "reward.age_weight": {"reward.age_weight": 1e15},
    "reward.location_penalty": LONG | {"reward.location_penalty": 1e15},
    "reward.unserved_penalty": LONG | {"reward.unserved_penalty": -1e15},
    "harvester.sensitivity_db": {"harvester.sensitivity_db": 300.0},
    "charging.directivity_index_db": {
        "charging.directivity_index_db": 300.0,
        "charging.power_w": 1e15,
        "harvester.load_resistance_ohm": 1e-15,
    },
    "channel.noise_level_db": {"channel.noise_level_db": -300.0},
    "uplink.packet_bits": {"uplink.packet_bits": 1e15},
    "uplink.bandwidth_hz": {"uplink.bandwidth_hz": 1e-15},
    "grid.spacing_m over auvs.speed": {"auvs.speed_m_per_s": 1e-11, "episode.duration_s": 1e14},
}
#: By key: what no list of implausible keys allows.
BEYOND = {
    "nodes.weights": [5e307, 5e307, 5e307],
    "reward.age_weight": 1e300,
    "reward.location_penalty": 1e300,
    "reward.unserved_penalty": -1e300,
    "harvester.sensitivity_db": 5000.0,
    "charging.directivity_index_db": 4000.0,
    "channel.noise_level_db": -1e4,
    "charging.power_w": 1e300,
    "harvester.load_resistance_ohm": 1e-300,
    "uplink.packet_bits": 1e300,
    "uplink.bandwidth_hz": 1e-300,
    "auvs.speed_m_per_s": 1e-300,
    "episode.duration_s": 1e300,
    "duplex.uplink_frequency_khz": 1e300,
    "observation.view_range_m": 1e300,
}


def load(name, settings):
    """A scenario with these settings, however implausible."""
    meant = sorted(settings.keys() & ranges_of(Scenario))
    return load_scenario(name, settings | {"allow_implausible": meant})


@pytest.mark.slow
@pytest.mark.parametrize(("duplex", "settings"), HELD.values(), ids=HELD)
@pytest.mark.parametrize(
    ("kind", "dtype"), [("paper", "float64"), ("scaled", "float64"), ("scaled", "float32")]
)
def test_numbers_are_held_without_a_warning(duplex, settings, kind, dtype):
    scenario = load(f"paper/k3-{duplex}", {"observation.kind": kind} | settings)
    world = World(scenario, 4, dtype=dtype)
    state = world.reset(node_codes(scenario, world.grid, [np.random.default_rng(0)] * 4))
    slot = UnrolledSlot(scenario, with_mask=True) if dtype == "float64" else None
    now = numbers(state.map(lambda array: array[:1]))
    rng = np.random.default_rng(0)
    ranges = world.observer.agent_ranges
    for t in range(min(40, world.num_slots)):
        shape = (4, world.num_auvs)
        action = np.stack([rng.integers(0, n, shape) for n in world.action_sizes], axis=-1)
        if t % 2:
            action[..., 1:] = 0
        state, events = world.step(state, action)
        seen = world.observe(state)
        for array in (*state, *events, world.reward(state, events), seen):
            assert np.isfinite(array).all()
        slack = 1e-6 * (1 + np.abs(ranges.high))
        assert ((seen >= ranges.low - slack) & (seen <= ranges.high + slack)).all()
        assert all(np.isfinite(values).all() for values in world.metrics(state).values())
        if slot:
            now, *others = slot(now, action[0].ravel().tolist())
            assert now == numbers(state.map(lambda array: array[:1]))
            assert all(np.isfinite(each).all() for each in others)


@pytest.mark.parametrize(("key", "settings"), REFUSED.items())
def test_numbers_that_cannot_be_held_are_refused_by_key(key, settings):
    scenario = load("paper/k3-fdd", settings)
    with pytest.raises(InputError) as refused:
        World(scenario)
    assert str(refused.value).startswith(key)
    assert str(refused.value).isprintable()


@pytest.mark.parametrize(("key", "value"), BEYOND.items())
def test_numbers_beyond_the_hard_limits_are_refused_though_allowed(key, value):
    with pytest.raises(InputError, match=f"{key}.*must be ") as refused:
        load("paper/k3-fdd", {key: value})
    assert str(refused.value).isprintable()


@pytest.mark.parametrize("name", ["greedy", "tour", "round-robin"])
def test_baselines_play_what_can_hardly_deliver_without_a_warning(name):
    scenario = load("paper/k3-fdd", {"duplex.uplink_frequency_khz": 30_000.0})
    world, policy = World(scenario, 2), make_baseline(name)
    rng = np.random.default_rng(0)
    state = world.reset(node_codes(scenario, world.grid, [rng] * 2))
    for _ in range(10):
        state, _ = world.checked_step(state, policy.act(world, state, rng))
    assert np.isfinite(state.energy_j).all()


def test_limits_change_nothing_that_is_plausible():
    for name, sonar in itertools.product(["paper/k10-fdd", "multi/m3-k20-tdd"], [{}, SONAR]):
        scenario = load_scenario(name, sonar)
        link = World(scenario).link
        free_w = link.budget._power_per_snr_w(link.distance_m)
        np.testing.assert_array_equal(link.power_per_snr_w, free_w)
