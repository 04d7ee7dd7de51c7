"""Numbers beyond what any sea or hardware has: refused, or allowed by name."""

import itertools

import numpy as np
import pytest
from batteries import BATTERY
from current_files import ORIGIN, WIDE
from loss_tables import as_npz
from seas import GUSTS, SHADOWING

from iout_marl import InputError, Scenario, bundled_names, load_scenario
from iout_marl.scenario import to_yaml
from iout_marl.scenario.fields import Plausible
from iout_marl.scenario.keys import all_keys, ranges, ranges_of

#: Losses of a table that reaches to all depths.
TABLE = as_npz(
    frequency_khz=[40.0],
    range_m=[10.0, 2000.0],
    auv_depth_m=[0.0, 1e5],
    node_depth_m=[0.0, 1e5],
    loss_db=np.full((1, 2, 2, 2), 40.0),
)
LOSSES = {"kind": "range_depth", "tables": [TABLE], "top_depth_m": 12.0}
#: The kinds that have between them every key with a range.
WHOLE = [
    load_scenario(
        "paper/k3-fdd", {"auvs.count": 1, "episode.slot_s": 20.0, "nodes.weights": [1, 1, 1]}
    ),
    load_scenario(
        "best/k3-tdd",
        {
            "grid.origin": {"latitude_deg": 60.0, "longitude_deg": 5.0, "depth_m": 20.0},
            "channel": {"kind": "sonar", "transmission": LOSSES},
            "harvester.area_m2": 0.02,
            "nodes": {"kind": "random", "count": 3},
            "observation.view_range_m": 100,
            "storage": {"kind": "capacitor", "capacity_j": 90.0},
            "vehicle": BATTERY,
            "training.target_kl": 0.1,
        },
    ),
    load_scenario(
        "best/k3-fdd",
        {
            "channel": {"kind": "sonar", "fading": SHADOWING, "wind": GUSTS},
            "harvester": {"kind": "aperture", "area_m2": 0.02, "efficiency": 0.5},
            "uplink": {
                "kind": "modem",
                "bit_rate_bps": 5000.0,
                "packet_bits": 2048.0,
                "bandwidth_hz": 5000.0,
                "electronics_w": 1.0,
                "maximum_source_level_db": 185.0,
            },
            "hearing": {"kind": "polling", "max_nodes_per_slot": 3},
            "observation": "table",
            "training.network": {"kind": "set", "heads": 1},
        },
    ),
    *(
        load_scenario(
            "paper/k3-fdd",
            {
                "auvs.speed_m_per_s": 4.0,
                "vehicle": {"kind": "unlimited", "max_speed_m_per_s": 6.0},
                "grid.origin": ORIGIN,
                "current": current,
            },
        )
        for current in (
            {"kind": "shear", "speed_m_per_s": 0.5, "toward_deg": 90.0, "depth_scale_m": 60.0},
            {"kind": "tide", "speed_m_per_s": 0.5, "toward_deg": 90.0},
            {
                "kind": "vortex",
                "circulation_m2_per_s": 100.0,
                "core_radius_m": 50.0,
                "center_m": [150.0, 250.0],
            },
            {"kind": "double_gyre", "amplitude_m_per_s": 0.5},
            {
                "kind": "gauss_markov",
                "speed_m_per_s": 0.5,
                "toward_deg": 90.0,
                "sigma_m_per_s": 0.1,
            },
            {"kind": "file", "file": WIDE},
        )
    ),
]


def at(scenario, key):
    for part in key.split("."):
        scenario = getattr(scenario, part, None)
    return scenario


def range_of(scenario, key):
    section, _, name = key.rpartition(".")
    return ranges(type(at(scenario, section)))[name]


def bounds():
    """(scenario, key, bound, value beyond it) for every range of every kind."""
    for scenario, key in itertools.product(WHOLE, sorted(ranges_of(Scenario))):
        if at(scenario, key) is not None:
            limits = range_of(scenario, key)
            for bound in (limits.low, limits.high):
                yield scenario, key, bound


BOUNDS = [pytest.param(*case, id=f"{case[1]}-{case[2]:g}") for case in bounds()]


def test_every_range_is_among_the_cases():
    assert {case.values[1] for case in BOUNDS} == ranges_of(Scenario)


def test_bundled_scenarios_need_nothing_allowed():
    assert all(load_scenario(name).allow_implausible == () for name in bundled_names())


@pytest.mark.slow
@pytest.mark.parametrize(("scenario", "key", "bound"), BOUNDS)
def test_beyond_a_range_a_number_must_be_allowed_by_name(scenario, key, bound):
    limits = range_of(scenario, key)
    is_whole = isinstance(at(scenario, key), int) or key in ("grid.cells", "training.hidden_units")
    step = max(abs(bound) * 0.01, 1.0 if is_whole else 1e-3)
    number = bound - step if bound == limits.low else bound + step
    number = round(number) if is_whole else number
    value = at(scenario, key)
    value = [number, *value[1:]] if isinstance(value, tuple) else number
    with pytest.raises(InputError) as refused:
        load_scenario(scenario, {key: value})
    line = str(refused.value)
    if "is implausible" not in line:
        return  # a hard limit, or other keys, say no before
    assert line.startswith(f"override {key}: {key}")
    assert f"usual are {limits.low:g} to {limits.high:g}" in line
    assert line.endswith(f"; if it is meant, write allow_implausible: [{key}]")
    try:
        allowed = load_scenario(scenario, {key: value, "allow_implausible": [key]})
    except InputError as error:
        assert "is implausible" not in str(error)  # noqa: PT017 (other keys may say no)
    else:
        assert load_scenario(allowed).hash == allowed.hash != scenario.hash
        assert f"allow_implausible: [{key}]" in to_yaml(allowed)


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("duplex.uplink_frequency_khz", 30_000, "30000 kHz is implausible: usual are 0.1 to 1000 "),
        ("duplex.uplink_frequency_khz", 30_000, "kHz (was 30 meant?)"),
        ("duplex.charging_frequency_khz", 0.01, "0.01 kHz is implausible"),
        ("harvester.sensitivity_db", 150, "(was -150 meant?)"),
        ("harvester.sensitivity_db", -15, "(was -150 meant?)"),
        ("uplink.bandwidth_hz", 3, "(was 3000 meant?)"),
        ("grid.spacing_m", 1e6, "1e+06 m is implausible: usual are 0.01 to 10000 m"),
        ("nodes.weights", [1, 1, 1e9], "nodes.weights[2]: 1e+09 is implausible"),
        ("training.hidden_units", [64, 10**6], "training.hidden_units[1]: 1e+06 units is impl"),
        ("grid.cells", [100_000, 1, 1], "grid.cells[0]: 100000 cells is implausible"),
        ("training.environments", 10**6, "1e+06 environments is implausible"),
    ],
)
def test_what_is_said(key, value, said):
    changes = {key: value}
    if key == "grid.cells":
        changes |= {"nodes.cells": [[1, 1, 1]], "nodes.weights": None}
        changes |= {"auvs.start_cells": [[1, 1, 1]]}
    with pytest.raises(InputError) as refused:
        load_scenario(WHOLE[0], changes)
    assert said in str(refused.value)


def test_all_that_is_implausible_is_named_at_once():
    changes = {"harvester.sensitivity_db": 150, "charging.power_w": 1e9, "nodes.weights": [1e9] * 3}
    with pytest.raises(InputError) as refused:
        load_scenario("paper/k3-fdd", changes)
    assert str(refused.value).endswith(
        "; so is charging.power_w, harvester.sensitivity_db; if it is meant, write "
        "allow_implausible: [charging.power_w, harvester.sensitivity_db, nodes.weights]"
    )


def test_what_is_allowed_in_a_file_is_allowed_over_it(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(
        "extends: paper/k3-fdd\nallow_implausible: [charging.power_w]\ncharging: {power_w: 1e9}"
    )
    assert load_scenario(path).charging.power_w == 1e9
    assert load_scenario(path, {"charging.power_w": 2e9}).charging.power_w == 2e9
    with pytest.raises(InputError, match=r"usual are .*allow_implausible: \[charging\.power_w\]"):
        load_scenario(path, {"allow_implausible": []})
    both = r"write allow_implausible: \[charging\.power_w, grid\.spacing_m\]"
    with pytest.raises(InputError, match=both):
        load_scenario(path, {"grid.spacing_m": 1e6})


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        (
            ["harvester.sensitivty_db"],
            "allow_implausible[0]: unknown key 'harvester.",
        ),
        (["harvester.sensitivty_db"], "; did you mean 'harvester.sensitivity_db'?"),
        (["grid.spacing_m", "name"], "allow_implausible[1]: 'name' has no plausible range"),
        (["nodes.weights[0]"], "unknown key 'nodes.weights[0]'; did you mean 'nodes.weights'?"),
        ("grid.spacing_m", "allow_implausible: must be a list, not 'grid.spacing_m'"),
        ([3], "allow_implausible[0]: must be a valid string, not 3"),
    ],
)
def test_keys_that_cannot_be_allowed(keys, expected):
    with pytest.raises(InputError) as refused:
        load_scenario("paper/k3-fdd", {"allow_implausible": keys})
    assert expected in str(refused.value)


def test_ranges_are_told_by_a_generated_schema():
    schema = Scenario.model_json_schema()["$defs"]
    assert schema["FrequencyDivisionSettings"]["properties"]["uplink_frequency_khz"][
        "plausible"
    ] == {
        "low": 0.1,
        "high": 1000,
        "unit": "kHz",
    }
    assert schema["Training"]["properties"]["hidden_units"]["items"]["plausible"]["high"] == 16_384


def test_every_number_of_a_scenario_has_a_range_or_hard_limits_alone():
    without = {key for key in all_keys(Scenario) if key not in ranges_of(Scenario)}
    numbers = {
        key
        for key in without
        for scenario in WHOLE
        if isinstance(at(scenario, key), int | float) and not isinstance(at(scenario, key), bool)
    }
    assert numbers == {
        "channel.shipping",
        "channel.spreading_factor",
        "channel.uplink_efficiency",
        "charging.efficiency",
        "current.epsilon",
        "current.phase_deg",
        "current.toward_deg",
        "duplex.beta_max",
        "grid.origin.bearing_deg",
        "grid.origin.latitude_deg",
        "grid.origin.longitude_deg",
        "duplex.beta_min",
        "fairness.minimum_jain",
        "harvester.efficiency",
        "training.checkpoint_steps",
        "training.discount",
        "training.gae_lambda",
        "training.imitation_share",
        "training.learning_rate",
        "vehicle.initial_share",
        "vehicle.propulsion_efficiency",
    }


def test_a_range_and_what_it_says():
    limits = Plausible(1, 10, "m", slips=(100, -1))
    assert limits.holds(1)
    assert limits.holds(10)
    assert not limits.holds(float("nan"))
    assert limits.doubt(0.05) == "0.05 m is implausible: usual are 1 to 10 m (was 5 meant?)"
    assert limits.doubt(-3) == "-3 m is implausible: usual are 1 to 10 m (was 3 meant?)"
    assert Plausible(0, 1).doubt(7) == "7 is implausible: usual are 0 to 1"
