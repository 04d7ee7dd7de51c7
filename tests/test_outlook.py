"""The line that says when energy does not matter, or never suffices."""

import warnings

import numpy as np
import pytest

from iout_marl import World, bundled_names, load_scenario
from iout_marl.outlook import energy_outlook
from iout_marl.world import node_codes

HERTZ = {"duplex.uplink_frequency_khz": 30_000, "duplex.charging_frequency_khz": 40_000}
FAR = {"grid.spacing_m": 1e6, "auvs.speed_m_per_s": 40_000}


def outlook(name="paper/k3-fdd", **changes):
    allowed = {"allow_implausible": [*HERTZ, *FAR, "harvester.sensitivity_db"]}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return energy_outlook(load_scenario(name, changes | allowed))


@pytest.mark.slow
@pytest.mark.parametrize("name", bundled_names())
def test_of_bundled_scenarios_there_is_nothing_to_say(name):
    assert energy_outlook(load_scenario(name)) is None


@pytest.mark.parametrize("name", ["paper/k3-fdd", "paper/k3-tdd", "best/k3-tdd", "random/k3-fdd"])
def test_a_forgotten_sign_makes_energy_plentiful(name):
    line = outlook(name, **{"harvester.sensitivity_db": 150})
    assert line.startswith("energy can never bind: a slot harvests 5.89e+30 J to ")
    assert "the dearest uplink takes " in line


def test_of_auvs_that_disturb_one_another_less_is_promised():
    line = outlook("multi/m3-k10-fdd", **{"harvester.sensitivity_db": 100})
    assert line.startswith("energy can bind only where uplinks disturb one another: a slot ")
    assert line.endswith(" J alone")


@pytest.mark.parametrize("name", ["paper/k3-fdd", "paper/k3-tdd", "multi/m3-k10-tdd"])
def test_a_source_without_power_delivers_nothing(name):
    line = outlook(name, **{"charging.power_w": 1e-3})
    assert line == (
        "nothing can ever be delivered: a slot harvests 2.95e-06 J to 0.000421 J, and the "
        "cheapest uplink takes 23.1 J, more than all 100 slots of an episode bring"
    )


@pytest.mark.parametrize(
    ("key", "name", "reason"),
    [
        ("duplex.uplink_frequency_khz", "heard", "over 100 m sound of 30000 kHz loses 24,757 dB"),
        ("duplex.charging_frequency_khz", "charged", "over 100 m sound of 40000 kHz loses 44,"),
    ],
)
def test_hertz_for_kilohertz(key, name, reason):
    line = outlook(**{key: HERTZ[key]})
    assert line.startswith(f"a node can be {name} from its own cell alone: from the next one ")
    assert reason in line


def test_cells_that_are_too_large():
    line = outlook(**FAR)
    assert line.startswith("a node can be heard from its own cell alone: from the next one ")
    assert "more than all 100 slots of an episode bring (over 1e+06 m sound of 30 kHz" in line


def test_packets_that_no_band_can_carry():
    line = outlook(**{"uplink.packet_bits": 1e8, "uplink.bandwidth_hz": 10})
    assert line.startswith("nothing can ever be delivered: ")
    assert "takes more than 1e+36 J" in line


AT_SEA = {
    "channel.kind": "sonar",
    "harvester": {"kind": "aperture", "area_m2": 0.02, "efficiency": 0.5},
    "uplink": {
        "kind": "modem",
        "bit_rate_bps": 5000,
        "packet_bits": 2048,
        "bandwidth_hz": 5000,
        "electronics_w": 1,
        "maximum_source_level_db": 185,
    },
}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            {"harvester.threshold_w": 90, "charging.power_w": 100},
            "no node can ever be charged: from no cell that AUVs reach does one harvest anything",
        ),
        (
            {"harvester.threshold_w": 90},
            (
                "a node can be charged from its own cell alone: from the next one a slot brings 0 "
                "J, and the cheapest uplink takes 0.41 J (over 100 m sound of 40 kHz loses 31 dB)"
            ),
        ),
        (
            {"uplink.maximum_source_level_db": 100, "uplink.required_snr_db": 39.9},
            (
                "a node can be heard from its own cell alone: from the next one it is out of range "
                "(over 100 m sound of 30 kHz loses 31 dB)"
            ),
        ),
        (
            {
                "uplink.maximum_source_level_db": 100,
                "uplink.required_snr_db": 40,
                "channel.wind_m_per_s": 30,
            },
            "no node can ever be heard: from every cell that AUVs reach each is out of range",
        ),
        ({}, None),
    ],
)
def test_apertures_and_modems(changes, said):
    assert outlook(**AT_SEA, **changes) == said


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        # AUVs never come to the depth of the nodes, and so to no cell of one.
        (
            {"harvester.threshold_w": 1},
            "no node can ever be charged: from no cell that AUVs reach does one harvest anything",
        ),
        (
            {"harvester.threshold_w": 1, "auvs.motion": "hover"},
            "a node can be charged from its own",
        ),
        (
            {"uplink.maximum_source_level_db": 100},
            "no node can ever be heard: from every cell that AUVs reach each is out of range",
        ),
        (
            {"vehicle.capacity_j": 135e3},
            (
                "no node can ever be charged: a slot of charging and hotel load takes 1.36e+05 J, "
                "and the battery of an AUV has 1.35e+05 J"
            ),
        ),
        ({"vehicle.capacity_j": 137e3}, None),
        ({"vehicle.initial_share": 0.009}, "no node can ever be charged: a slot of charging and"),
        (
            {
                "vehicle.initial_share": 0.009,
                "vehicle.docks": [[1, 1, 2]],
                "vehicle.dock_power_w": 500,
            },
            None,
        ),
    ],
)
def test_of_a_bay(changes, said):
    line = outlook("sea/bay", **changes)
    assert line is None if said is None else line.startswith(said)


def test_where_batteries_may_run_out_energy_can_bind():
    plenty = {"harvester.sensitivity_db": 150}
    battery = {"kind": "battery", "capacity_j": 1e9, "hotel_w": 40, "drag_area_m2": 3}
    battery |= {"drag_coefficient": 0.006, "propulsion_efficiency": 0.7}
    assert outlook(**plenty).startswith("energy can never bind")
    assert outlook(**plenty, vehicle=battery) is None


def test_a_grid_of_one_cell():
    alone = {"grid.cells": [1, 1, 1], "nodes.cells": [[1, 1, 1]], "auvs.start_cells": [[1, 1, 1]]}
    assert "energy can never bind: a slot harvests 842 J to 842 J" in outlook(**alone)


@pytest.mark.parametrize(
    ("name", "power_w", "spacing_m", "never_binds"),
    [
        ("paper/k3-fdd", 2e3, 100, False),
        ("paper/k3-fdd", 4e4, 100, False),
        ("paper/k3-fdd", 1e6, 100, True),
        ("best/k3-tdd", 1e6, 100, False),
        ("best/k3-tdd", 1e6, 50, True),
    ],
)
def test_where_energy_never_binds_whoever_is_charged_and_heard_delivers(
    name, power_w, spacing_m, never_binds
):
    changes = {"charging.power_w": power_w, "grid.spacing_m": spacing_m}
    scenario = load_scenario(name, changes)
    world, rng = World(scenario, 50), np.random.default_rng(0)
    state = world.reset(node_codes(scenario, world.grid, [rng] * 50))
    delivered = []
    for _ in range(world.num_slots):
        direction, node = (rng.integers(0, n, (50, 1)) for n in world.action_sizes[:2])
        action = np.stack([direction, *[node] * (len(world.action_sizes) - 1)], axis=-1)
        state, events = world.step(state, action)
        delivered.append(events.delivered)
    assert (energy_outlook(scenario) or "").startswith("energy can never bind") == never_binds
    assert np.all(delivered) == never_binds


STORES = {
    "nothing can ever be delivered: a store holds 20 J, and the cheapest uplink takes 23.1 J": {
        "capacity_j": 20.0
    },
    "no node can save energy from slot to slot: leakage and idle draw take 1e+03 J in a slot, "
    "which harvests at most 842 J": {"capacity_j": 900.0, "leakage_w": 15.0, "idle_w": 25.0},
}


@pytest.mark.parametrize("line", STORES)
def test_stores_that_hold_or_keep_too_little(line):
    assert outlook(storage={"kind": "capacitor", **STORES[line]}) == line


def test_stores_that_lose_all_that_a_weak_source_brings():
    line = outlook(
        storage={"kind": "capacitor", "capacity_j": 900.0, "idle_w": 1.0}, **{"charging.power_w": 5}
    )
    assert line == (
        "nothing can ever be delivered: leakage and idle draw take 25 J in a slot, which harvests "
        "at most 2.1 J, and the cheapest uplink takes 23.1 J"
    )


def test_what_a_store_holds_may_be_too_little_for_the_next_cell():
    line = outlook(storage={"kind": "capacitor", "capacity_j": 40.0})
    assert line.startswith("a node can be heard from its own cell alone: from the next one ")
    assert "more than a store holds, 40 J (over 100 m " in line


def test_of_stores_with_limits_it_is_never_said_that_energy_does_not_bind():
    ample = {"charging.power_w": 1e6}
    assert outlook(**ample).startswith("energy can never bind")
    assert outlook(storage={"kind": "capacitor", "capacity_j": 500.0}, **ample) is None


@pytest.mark.parametrize("own", ["zero", "mean"])
def test_the_next_cell_is_the_nearest_one_of_cells_that_are_no_cubes(own):
    key = "duplex.uplink_frequency_khz"
    changes = {"grid.spacing_m": [120, 90, 80], "grid.own_cell_distance": own}
    line = outlook(**changes, **{key: HERTZ[key]})
    if own == "zero":
        assert line.startswith("a node can be heard from its own cell alone: from the next one ")
        assert "over 80 m sound of 30000 kHz" in line
    else:  # nor from there, 64 m away on average
        assert line.startswith("nothing can ever be delivered: ")


def test_of_levels_that_fade_nothing_is_promised():
    sea = {
        "channel": {"kind": "sonar"},
        "harvester.area_m2": 0.02,
        "charging.power_w": 20_000,
        "uplink": {
            "kind": "modem",
            "bit_rate_bps": 5000.0,
            "packet_bits": 2048.0,
            "bandwidth_hz": 5000.0,
            "electronics_w": 1e-3,
            "maximum_source_level_db": 190.0,
        },
    }
    assert outlook(**sea).startswith("energy can never bind")
    fading = {"kind": "shadowing", "sigma_db": 3.0, "coherence_s": 600.0}
    assert outlook(**sea, **{"channel.fading": fading}) is None
