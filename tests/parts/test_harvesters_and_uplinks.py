"""Apertures and modems in a world, and what does not go with them."""

import warnings

import numpy as np
import pytest

from iout_marl import InputError, World, bounds, errors, evaluate, load_scenario, parts
from iout_marl.core.limits import DEAREST_J
from iout_marl.envs import AUVVectorEnv
from iout_marl.parts.beta_rule.paper import PaperRule
from iout_marl.policies.choice import near_uplink_j
from trainers import Trainer

APERTURE = {"kind": "aperture", "area_m2": 0.02, "efficiency": 0.5}
MODEM = {
    "kind": "modem",
    "bit_rate_bps": 5000.0,
    "packet_bits": 2048.0,
    "bandwidth_hz": 5000.0,
    "electronics_w": 1.0,
    "maximum_source_level_db": 112.0,
}
SEA = {
    "channel": {"kind": "sonar", "spreading_factor": 2.0},
    "grid.spacing_m": 20,
    "auvs.speed_m_per_s": 1.0,
    "episode.duration_s": 600,
}
DUPLEXES = {
    "fdd": ("best/k3-fdd", {**SEA, "harvester": APERTURE, "uplink": MODEM}),
    "tdd": (
        "best/k3-tdd",
        {**SEA, "harvester": APERTURE, "uplink": MODEM, "duplex.beta_rule": "airtime"},
    ),
}
both = pytest.mark.parametrize("duplex", DUPLEXES)


def scenario(duplex, **changes):
    name, overrides = DUPLEXES[duplex]
    return load_scenario(name, overrides | changes)


def slots(world, seed=0):
    rng, state = np.random.default_rng(seed), world.reset(seed=seed)
    shape = world.num_envs, world.num_auvs
    for _ in range(world.num_slots):
        action = np.stack([rng.integers(0, n, shape) for n in world.action_sizes], -1)
        before = state
        state, events = world.step(before, action)
        yield before, events, state


def test_no_more_is_harvested_than_passes_or_is_emitted():
    """What hydrophones without an area harvest in the AUV's own cell, is 33 times the source."""
    free, limited, aperture = (
        World(load_scenario("paper/k3-fdd", {**SEA, **changes})).link.harvested_w
        for changes in (
            {},
            {"harvester.area_m2": 0.2},
            {"harvester": {**APERTURE, "area_m2": 0.2}},
        )
    )
    assert free.max() > 30_000
    assert limited.max() <= 0.7 * 1000
    assert aperture.max() == 0.5 * 1000
    assert (limited <= free).all()
    # All of them are above what the area lets through: 0.7 of it is stored, not 0.5.
    np.testing.assert_allclose(limited, np.minimum(free, aperture * 0.7 / 0.5), rtol=1e-12)


@both
def test_a_packet_takes_its_airtime_wherever_the_auv_is(duplex):
    """0.4096 s of 1 W, and the sound; beyond the maximum level nothing is sent."""
    link = World(scenario(duplex)).link
    reached = link.slot_uplink_j < DEAREST_J
    assert link.slot_uplink_j[reached] == pytest.approx(0.4096, rel=1e-3)
    level_db = 10 * np.log10(link.power_per_snr_w * 10 * 0.5) + 170.8
    np.testing.assert_array_equal(reached, level_db <= 112)
    assert 0 < reached.sum() < reached.size


@both
@pytest.mark.parametrize("level_db", [112.0, 102.0])
def test_stored_energy_is_compared_with_uplinks_in_range(duplex, level_db):
    """Half the grid's diagonal is out of range, at 102 dB the next cell too."""
    world = World(scenario(duplex, **{"uplink.maximum_source_level_db": level_db}))
    for reference_j in (world.representation.reference_energy_j, near_uplink_j(world)):
        assert reference_j == pytest.approx(0.4096, rel=1e-3)


@both
def test_nodes_out_of_range_are_said_to_be(duplex):
    world, seen = World(scenario(duplex, **{"charging.power_w": 200}), 4), set()
    for before, events, after in slots(world):
        found = np.array(world.outcomes(before, events, after), dtype=object)[:, 0]
        named = world.transition.addressed(
            before.node_cell, after.cell, events.charged, events.heard
        )
        is_far = world.link.at(world.link.slot_uplink_j, named.heard_offset)[:, 0] >= DEAREST_J
        codes = np.array([reason and reason.code for reason in found])
        np.testing.assert_array_equal(codes == "out_of_range", is_far)
        seen |= set(codes.tolist())
    silent = {"fdd": "not_enough_energy", "tdd": "only_charged"}[duplex]
    assert seen == {"out_of_range", silent, None}


def test_beta_leaves_time_for_packet_call_and_answer():
    """1 − (L/R + 2 d/c)/τ in slots of 4 s, no more than β_max."""
    changes = {"auvs.speed_m_per_s": 5.0, "duplex.beta_max": 0.89}
    world = World(scenario("tdd", **changes), 4)
    found = set()
    for before, events, after in slots(world):
        named = world.transition.addressed(
            before.node_cell, after.cell, events.charged, events.heard
        )
        metres = world.link.at(world.link.distance_m, named.heard_offset)
        expected = np.minimum(1 - (0.4096 + 2 * metres / 1500) / 4, 0.89)
        np.testing.assert_allclose(events.beta, np.where(events.delivered, expected, 1))
        found |= set(events.beta.ravel().tolist())
    assert {0.89, 1.0} < found


@pytest.mark.slow
@both
@pytest.mark.parametrize("changes", [{}, {"harvester.threshold_w": 0.02}], ids=["", "threshold"])
def test_policies_and_bounds_bear_infinite_prices_and_no_harvest(duplex, changes):
    here = scenario(duplex, **{"episode.duration_s": 240}, **changes)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = bounds.bound(here, seconds=0.2)
        assert found.energy_and_travel is not None
        for policy in ("greedy", "tour", "round-robin", "planner"):
            played = evaluate(here, policy, episodes=1).metrics["mean_aoi"].mean
            assert played >= found.best - 1e-9


@both
def test_batches_and_trainings(duplex):
    here = scenario(duplex, **{"auvs.count": 2})
    envs = AUVVectorEnv(here, 3)
    envs.reset(seed=1)
    observations, rewards, *_ = envs.step(envs.action_space.sample())
    assert np.isfinite(rewards).all()
    assert np.isfinite(observations).all()
    trainer = Trainer(
        load_scenario(here, {"training.environments": 4, "training.rollout_slots": 8}), 0, "cpu"
    )
    trainer.iterate()
    assert all(bool(weights.isfinite().all()) for weights in trainer.weights(0).values())


def test_both_floating_types_choose_alike():
    singles = [World(scenario("fdd"), dtype=dtype) for dtype in ("float64", "float32")]
    played = [[events.delivered.item() for _, events, _ in slots(world)] for world in singles]
    assert played[0] == played[1]
    assert any(played[0])


def test_of_divided_bands_each_has_a_part_of_the_bit_rate():
    one, two = (World(scenario("fdd", **{"auvs.count": n})).link for n in (1, 2))
    here = one.distance_m == 0
    assert two.least_uplink_s[here] == pytest.approx(2 * one.least_uplink_s[here])
    reached = (one.slot_uplink_j < DEAREST_J) & (two.slot_uplink_j < DEAREST_J)
    np.testing.assert_allclose(two.slot_uplink_j[reached] / one.slot_uplink_j[reached], 2, 1e-2)


REFUSED = {
    "levels that are none": (
        "fdd",
        {"channel.kind": "table"},
        (
            "harvester.kind: 'aperture' takes levels in consistent units, such as those of "
            "channel.kind: sonar, which 'table' does not have"
        ),
    ),
    "a modem in levels that are none": (
        "fdd",
        {
            "channel.kind": "equation",
            "harvester": {
                "kind": "hydrophone",
                "sensitivity_db": -150,
                "efficiency": 0.7,
                "hydrophones": 1,
                "load_resistance_ohm": 125,
            },
        },
        "uplink.kind: 'modem' takes levels in consistent units",
    ),
    "an area in levels that are none": (
        "paper/k3-fdd",
        {"harvester.area_m2": 0.02},
        "harvester.area_m2: what passes an area follows from levels in consistent units",
    ),
    "time that packets cannot have": (
        "tdd",
        {"duplex.beta_rule": "stored"},
        (
            "uplink.kind: 'modem' takes a time of its own for a packet, whatever time there is: "
            "time division takes duplex.beta_rule: airtime for it"
        ),
    ),
    "packets without an airtime": (
        "best/k3-tdd",
        {"duplex.beta_rule": "airtime"},
        (
            "duplex.beta_rule: 'airtime' is for uplinks that take a time of their own, such as "
            "uplink.kind: modem, not for 'shannon'"
        ),
    ),
    "others in the band": (
        "fdd",
        {"channel.access": "interference", "auvs.count": 2},
        (
            "uplink.kind: 'modem' does not raise its level against other uplinks: for several AUVs "
            "channel.access must be orthogonal or exclusive, not 'interference'"
        ),
    ),
    "packets longer than a slot": (
        "fdd",
        {"uplink.bit_rate_bps": 100},
        "uplink.bit_rate_bps: a packet takes 20.5 s, but there are at most 20 s in a slot for it",
    ),
    "packets longer than what charging leaves": (
        "tdd",
        {"uplink.bit_rate_bps": 110},
        "uplink.bit_rate_bps: a packet takes 18.6 s, but there are at most 18 s in a slot for it",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_does_not_go_together(case):
    name, changes, line = REFUSED[case]
    base = scenario(name) if name in DUPLEXES else load_scenario(name)
    with pytest.raises(InputError) as refused:
        load_scenario(base, changes)
    assert line in str(refused.value)


def test_a_rule_for_beta_of_ones_own_does_not_take_modems_unless_it_says_so():
    """Such rules weigh the time of an uplink against its price, as Shannon's rate has it."""
    assert PaperRule.uplinks_fill_their_time
    assert parts.BetaRule.uplinks_fill_their_time


def test_hydrophones_without_an_area_are_served_with_one_warning():
    errors.warn_once.cache_clear()
    scenarios = [load_scenario(f"paper/k{k}-fdd", {"channel.kind": "sonar"}) for k in (3, 5)]
    with pytest.warns(errors.Note, match=r"^harvester\.area_m2 is not given: ") as found:
        worlds = [World(each) for each in scenarios]
    assert len(found) == 1 < len(worlds)


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("paper/k3-fdd", {}),
        ("paper/k3-fdd", {"channel.kind": "sonar", "harvester.area_m2": 0.1}),
        ("fdd", {}),
    ],
)
def test_others_with_none(name, changes):
    errors.warn_once.cache_clear()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        World(scenario(name) if name in DUPLEXES else load_scenario(name, changes))


@pytest.mark.filterwarnings("default::RuntimeWarning")
def test_the_command_line_says_it_in_one_line(iout):
    errors.warn_once.cache_clear()
    status, _, err = iout("show", "paper/k3-fdd", "--set", "channel.kind=sonar")
    assert status == 0
    assert err.startswith("note: harvester.area_m2 is not given: hydrophones without one may ")
    assert err.count("\n") == 1
    assert iout("show", "paper/k3-fdd", "--set", "channel.kind=sonar")[2] == ""
