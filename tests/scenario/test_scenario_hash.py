"""A scenario's hash: the same for equal scenarios, another one for whatever matters."""

import random
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from batteries import BATTERY, DOCKS
from current_files import ORIGIN, WIDE, csv_file, uneven

from iout_marl import InputError, bundled_names, load_scenario
from iout_marl.scenario import to_yaml

SCENARIOS = {
    "tide": load_scenario(
        "paper/k3-fdd",
        {
            "vehicle.max_speed_m_per_s": 9.0,
            "current": {"kind": "tide", "speed_m_per_s": 0.3, "toward_deg": 40.0},
        },
    ),
    "fdd": load_scenario("paper/k3-fdd"),
    "tdd": load_scenario("best/k3-tdd"),
    "sonar": load_scenario(
        "paper/k3-tdd",
        {
            "channel": {"kind": "sonar", "absorption": {"kind": "francois_garrison"}},
            "nodes": {"kind": "random", "count": 4},
            "storage": {"kind": "capacitor", "capacity_j": 90.0, "initial_j": 5.0, "idle_w": 1e-3},
            "vehicle": {**BATTERY, **DOCKS},
            "training.target_kl": 0.1,
        },
    ),
    "modem": load_scenario(
        "best/k3-tdd",
        {
            "channel.kind": "sonar",
            "harvester": {"kind": "aperture", "area_m2": 0.02, "efficiency": 0.5},
            "uplink": {
                "kind": "modem",
                "bit_rate_bps": 5000.0,
                "packet_bits": 2048.0,
                "bandwidth_hz": 5000.0,
                "electronics_w": 1.0,
                "maximum_source_level_db": 185.0,
            },
            "duplex.beta_rule": "airtime",
        },
    ),
}
WORDS = (
    "fixed", "random", "run", "episode", "thorp", "francois_garrison", "table", "equation",
    "sonar", "fdd", "tdd", "paper", "stored", "mean_age", "scaled", "none", "info",
    "observation", "constant", "linear", "tanh", "relu", "running", "first_rollout",
    "orthogonal", "interference", "exclusive", "six", "hover", "team", "difference",
    "own", "central", "adam", "AdamW", "mean", "airtime", "packet_start", "bpsk", "gap",
)  # fmt: skip
#: Names, keys with a single possible value, and a kind that needs other keys beside it.
LEFT_OUT = {
    "name",
    "description",
    "allow_implausible",
    "grid.origin",
    "training.preset",
    "training.network",
    "training.over",
    "nodes.kind",
    "harvester.kind",
    "uplink.kind",
    "storage.kind",
    "vehicle.kind",
    "current",
    "current.file",
    "current.kind",
    "hearing",
    "channel.transmission",
    "channel.fading",
    "channel.wind",
}
#: Of some scenarios: keys that no other value goes with.
DETERMINED = {
    ("fdd", "harvester.area_m2"),
    ("tdd", "harvester.area_m2"),
    ("tide", "harvester.area_m2"),
    ("modem", "channel.kind"),
    ("modem", "duplex.beta_rule"),
}


def leaves(data, path=""):
    for key, value in data.items():
        here = f"{path}.{key}" if path else key
        if isinstance(value, dict):
            yield from leaves(value, here)
        else:
            yield here, value


def other_values(value):
    """Values of the same kind, of which at least one should be allowed."""
    if isinstance(value, bool):
        return [not value]
    if isinstance(value, int):
        return [value + 1, value - 1]
    if isinstance(value, float):
        return [value * 1.001 + 1e-9, value * 0.999]
    if isinstance(value, str):
        return [word for word in WORDS if word != value]
    if value == ():
        return [("time",)]
    if isinstance(value, tuple):
        return [(item, *value[1:]) for item in other_values(value[0])]
    return [1, 0.5, 25.0, [1.0, 1.0, 2.0], [1.0, 1.0, 1.0, 2.0], "tour"]


LEAVES = [
    pytest.param(name, key, value, id=f"{name}-{key}")
    for name, scenario in SCENARIOS.items()
    for key, value in leaves(scenario.model_dump())
    if key not in LEFT_OUT and (name, key) not in DETERMINED
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "key", "value"), LEAVES)
def test_changes_with_every_value(name, key, value):
    scenario, changed = SCENARIOS[name], []
    for other in other_values(value):
        with suppress(InputError):
            changed.append(load_scenario(scenario, {key: other}))
    changed = [c for c in changed if c != scenario]
    assert changed, "no other value is allowed"
    assert all(c.hash != scenario.hash for c in changed)
    is_of_the_world = not key.startswith(("reward.", "training."))
    assert all((c.world_hash != scenario.world_hash) == is_of_the_world for c in changed)


def test_changes_with_the_kind_of_hearing():
    one = SCENARIOS["modem"]
    two, three = (
        load_scenario(one, {"hearing": {"kind": "polling", "max_nodes_per_slot": most}})
        for most in (2, 3)
    )
    assert len({each.hash for each in (one, two, three)}) == 3
    assert len({each.world_hash for each in (one, two, three)}) == 3
    assert load_scenario("paper/k3-fdd", {"hearing": "one"}).hash == SCENARIOS["fdd"].hash
    assert "hearing: one" in to_yaml(one)


@pytest.mark.parametrize(
    ("current", "is_part_of_it"),
    [
        ({"kind": "file", "file": WIDE}, True),
        ({"kind": "shear", "speed_m_per_s": 0.5, "toward_deg": 90.0, "depth_scale_m": 60.0}, True),
        ({"kind": "uniform", "speed_m_per_s": 0.5, "toward_deg": 90.0}, False),
        ("none", False),
    ],
)
def test_changes_with_the_place_on_earth_where_results_depend_on_it(current, is_part_of_it):
    world = {"vehicle.max_speed_m_per_s": 9.0, "current": current, "grid.origin": ORIGIN}
    here, there = (
        load_scenario("paper/k3-fdd", {**world, "grid.origin.depth_m": depth_m})
        for depth_m in (4.0, 5.0)
    )
    assert (here.hash != there.hash) == (here.world_hash != there.world_hash) == is_part_of_it


def test_changes_with_the_current():
    still = load_scenario("paper/k3-fdd", {"vehicle.max_speed_m_per_s": 9.0})
    tide = {"kind": "tide", "speed_m_per_s": 0.3, "toward_deg": 40.0}
    flowing = [
        load_scenario(still, {"current": {**tide, **more}})
        for more in ({}, {"phase_deg": 10.0}, {"speed_m_per_s": 0.31})
    ]
    for file in (WIDE, csv_file([0.0], [0.0, 900.0], [-9.0, 900.0], [-9.0, 900.0], uneven)):
        current = {"kind": "file", "file": file}
        flowing.append(load_scenario(still, {"grid.origin": ORIGIN, "current": current}))
    assert len({each.hash for each in (still, *flowing)}) == 6
    assert load_scenario(still, {"current": "none"}).hash == still.hash


def test_changes_with_the_kind_of_vehicle():
    unlimited = load_scenario("paper/k3-fdd", {"vehicle": "unlimited"})
    limited = load_scenario(unlimited, {"vehicle": BATTERY})
    assert unlimited.hash == load_scenario("paper/k3-fdd").hash != limited.hash
    assert "vehicle" in to_yaml(unlimited)


def test_changes_with_the_kind_of_storage():
    unlimited = load_scenario("paper/k3-fdd", {"storage": "unlimited"})
    limited = load_scenario(unlimited, {"storage": {"kind": "capacitor", "capacity_j": 1e9}})
    assert unlimited.hash == load_scenario("paper/k3-fdd").hash != limited.hash
    assert limited.world_hash != unlimited.world_hash


def test_changes_with_the_kind_of_layout():
    fixed = load_scenario("paper/k3-fdd")
    drawn = load_scenario(fixed, {"nodes": {"kind": "random", "count": 3}})
    assert drawn.hash != fixed.hash
    assert drawn.world_hash != fixed.world_hash


def test_changes_with_the_kinds_of_harvester_and_uplink():
    """Kinds that a file does not name are `hydrophone` and `shannon`, and leave no trace."""
    sonar, modem = SCENARIOS["sonar"], SCENARIOS["modem"]
    named = {"harvester.kind": "hydrophone", "uplink.kind": "shannon"}
    assert load_scenario("paper/k3-fdd", named).hash == SCENARIOS["fdd"].hash
    aperture = {"kind": "aperture", "area_m2": 0.02, "efficiency": 0.7}
    others = [load_scenario(sonar, {"harvester": aperture})]
    shannon = {"kind": "shannon", "packet_bits": 2048.0, "bandwidth_hz": 5000.0}
    others.append(load_scenario(modem, {"uplink": shannon, "duplex.beta_rule": "stored"}))
    hashes = {each.hash for each in (sonar, modem, *others)}
    assert len(hashes) == 4
    assert len({each.world_hash for each in (sonar, modem, *others)}) == 4


@pytest.mark.parametrize(
    "changes",
    [
        {"name": "x"},
        {"description": "y"},
        {"grid.origin": {"latitude_deg": 41.2, "longitude_deg": -8.7, "depth_m": 5}},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_ignores_names_and_places(changes):
    scenario = load_scenario("paper/k3-fdd")
    changed = load_scenario(scenario, changes)
    assert changed != scenario
    assert (changed.hash, changed.world_hash) == (scenario.hash, scenario.world_hash)


def test_changes_with_what_is_allowed_if_there_is_anything():
    scenario = load_scenario("paper/k3-fdd")
    nothing, one, both, turned = (
        load_scenario(scenario, {"allow_implausible": keys})
        for keys in (
            [],
            ["grid.spacing_m"],
            ["grid.spacing_m", "charging.power_w"],
            ["charging.power_w", "grid.spacing_m", "grid.spacing_m"],
        )
    )
    assert nothing.hash == scenario.hash
    assert len({nothing.hash, one.hash, both.hash}) == 3
    assert turned.hash == both.hash
    assert both.world_hash == scenario.world_hash


@pytest.mark.slow
@pytest.mark.parametrize("name", bundled_names())
def test_ignores_the_order_of_keys(name):
    scenario = load_scenario(name)

    def shuffled(data):
        if not isinstance(data, dict):
            return data
        keys = list(data)
        random.Random(name).shuffle(keys)
        return {key: shuffled(data[key]) for key in keys}

    assert load_scenario(shuffled(scenario.model_dump())).hash == scenario.hash


@pytest.mark.parametrize("written", ["30", "30.0", "3e1", "3.0E+1", "+30", "0x1e", "!!float 30"])
def test_ignores_how_a_number_is_written(written):
    scenario = load_scenario("paper/k3-fdd")
    assert scenario.channel.noise_level_db == 30
    assert load_scenario(scenario, [f"channel.noise_level_db={written}"]).hash == scenario.hash


def test_minus_zero_is_zero():
    zero, minus_zero = (
        load_scenario("paper/k3-fdd", [f"channel.noise_level_db={text}"]) for text in ("0", "-0.0")
    )
    assert zero == minus_zero
    assert zero.hash == minus_zero.hash


def test_ignores_defaults_that_are_spelt_out(tmp_path):
    path = tmp_path / "whole.yaml"
    path.write_text(to_yaml(load_scenario("best/k5-tdd")), encoding="utf-8")
    assert load_scenario(path).hash == load_scenario("best/k5-tdd").hash


def test_is_twelve_hexadecimal_digits():
    hashes = [load_scenario(name).hash for name in bundled_names()]
    assert len(set(hashes)) == len(hashes)
    assert all(len(h) == 12 and int(h, 16) >= 0 for h in hashes)


def test_same_world_has_the_same_world_hash():
    paper, best = load_scenario("paper/k3-fdd"), load_scenario("best/k3-fdd")
    assert paper.world_hash == best.world_hash
    assert paper.hash != best.hash


@pytest.mark.slow
def test_is_the_same_in_another_process():
    names = bundled_names()
    program = (
        "import sys; from iout_marl.scenario import load_scenario; "
        "print(*(load_scenario(n).hash for n in sys.argv[1:]))"
    )
    printed = subprocess.run(
        [sys.executable, "-c", program, *names],
        env={"PYTHONHASHSEED": "12345"},
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert printed.split() == [load_scenario(name).hash for name in names]


@pytest.mark.parametrize(
    ("name", "hash_then", "world_hash_then"),
    [
        ("run-0.1.0", "ca76af1826e5", "5611146a6792"),
        ("run-0.1.0-paper", "2a966538b64d", "cea7cf8bcf35"),
    ],
)
def test_scenario_of_a_run_folder_of_an_earlier_version(name, hash_then, world_hash_then):
    path = Path(__file__).parent / "fixtures" / f"{name}.yaml"
    scenario = load_scenario(path)
    assert (scenario.hash, scenario.world_hash) == (hash_then, world_hash_then)
    # What came later is written, too.
    text = to_yaml(scenario)
    for key in (
        "  own_cell_distance: zero",
        "  idle_choices: false",
        "  slot_s: null",
        "  sampling: slot_end",
        "  optimizer: adam",
        "  network: mlp",
        "  kind: hydrophone",
        "  kind: shannon",
        "  area_m2: null",
        "storage:\n  kind: unlimited",
        "vehicle:\n  kind: unlimited",
        "hearing: one",
        "current: none",
        "  max_speed_m_per_s: null",
        "  vehicle_energy_penalty_per_kj: 0.0",
        "  stranded_penalty: 0.0",
        "  transmission: formula",
        "  fading: none",
        "  wind: steady",
    ):
        text = text.replace(f"{key}\n", "")
    assert text == path.read_text(encoding="utf-8")


def test_keys_that_came_later_leave_the_hashes_of_before_as_they_were():
    # As printed with results from before `channel.access`, `reward.credit` and the others.
    assert load_scenario("paper/k10-fdd").hash == "468cc0bb0e2d"
    assert load_scenario("paper/k3-tdd").hash == "c16af987f02b"


def test_no_negative_zero_is_shown():
    scenario = load_scenario("paper/k3-fdd", ["training.discount=-0.0"])
    assert str(scenario.training.discount) == "0.0"
