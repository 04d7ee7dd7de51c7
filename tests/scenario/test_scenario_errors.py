"""Bad input is answered by one line: file, line, key, and what was meant."""

import os
import re
from pathlib import Path

import pytest

from iout_marl import InputError, load_scenario
from iout_marl.errors import MAX_MESSAGE


@pytest.fixture(autouse=True)
def _working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def message(source, overrides=()):
    with pytest.raises(InputError) as raised:
        load_scenario(source, overrides)
    text = str(raised.value)
    assert text.isprintable(), "not one line"
    assert len(text) <= MAX_MESSAGE
    return text


#: An AUV that its battery lasts for hours.
HULL = {
    "capacity_j": 1e6,
    "drag_area_m2": 3.0,
    "drag_coefficient": 0.006,
    "propulsion_efficiency": 0.7,
    "hotel_w": 40.0,
}
#: Whole files, and what follows `bad.yaml`.
FILES = {
    # Not YAML, or not a scenario at all.
    "a: [1, 2\nb: 3\n": ":2: broken YAML: ",
    "a: b: c\nd: 1\n": ":1: broken YAML: mapping values are not allowed here",
    "\tage: 1\n": ":1: broken YAML: ",
    "a: *x\nb: 1\n": ":1: broken YAML: found undefined alias 'x'",
    "age: 1\n---\nage: 2\n": ":2: broken YAML: ",
    "age: {}\nage: {}\n": ':2: broken YAML: found duplicate key "age"',
    "age:\n  initial: 1\n  initial: 2\n": ':3: broken YAML: found duplicate key "initial"',
    "a: \0": ": broken YAML: ",
    "a: \udcff": ": cannot be read: not UTF-8 text",
    "": ": is empty",
    "# nothing\n": ": is empty",
    "null": ": is empty",
    "age: {maximum: 9}": (
        ": grid: is missing (and 9 more); to begin with a bundled scenario, write extends: paper/k1"
    ),
    "title: a\ngroups: {}\n": ": is a study, not a scenario",
    "- a\n- b\n": ":1: must be a mapping of keys to values",
    "5": ":1: must be a mapping of keys to values",
    "just words": ":1: must be a mapping of keys to values",
    # Scalars that ruamel.yaml itself stumbles over.
    "name: !!int x": ":1: broken YAML: 'x' cannot be read as int",
    "name: !!bool x": ":1: broken YAML: 'x' cannot be read as bool",
    "name: 0x_": ":1: broken YAML: '0x_' cannot be read as int",
    "name: " + "9" * 5000: ":1: broken YAML: '999999999999999999999999999999999999... cannot be ",
    # Without end.
    "&a\nx: *a": ":2: broken YAML: nested too deeply, or within itself",
    "x: " + "[" * 1000: ":1: broken YAML: nested too deeply, or within itself",
    "\n".join(" " * i + "a:" for i in range(1000)): ":51: broken YAML: nested too deeply, or",
    "a: &a [" + "[" * 30 + "]" * 30 + "]\nb: " + "[" * 30 + "*a" + "]" * 30: (
        ":2: broken YAML: nested too deeply, or within itself"
    ),
    "a: &a [1,1,1,1,1,1,1,1]\n"
    + "".join(
        f"{key}: &{key} [{','.join([f'*{chr(ord(key) - 1)}'] * 8)}]\n" for key in "bcdefghi"
    ): (":5: broken YAML: more than 25,000 values"),
    "x: [" + "1," * 25_001 + "]": ":1: broken YAML: more than 25,000 values",
    "x: '" + "1" * 1_000_000 + "'": ": cannot be read: larger than 1,000,000 bytes",
    # Tags, and what else is no plain value.
    "a: !!foo [1]": ":1: broken YAML: the tag !!foo has no meaning here",
    "a:\n  b:\n  - !!foo {c: 1}": ":3: broken YAML: the tag !!foo has no meaning here",
    "!x\na: 1": ":1: broken YAML: the tag !x has no meaning here",
    "a: !!python/object/apply:os.system [ls]": ":1: broken YAML: the tag !!python/object/apply",
    "a: !!set {b, c}": ":1: broken YAML: the tag !!set has no meaning here",
    "a: !!omap [b: 1]": ":1: broken YAML: the tag !!omap has no meaning here",
    "a: !!pairs [b: 1]": ":1: broken YAML: the tag !!pairs has no meaning here",
    "a: !!seq {b: 1}": ":1: broken YAML: the tag !!seq has no meaning here",
    "a: !!map [b]": ":1: broken YAML: the tag !!map has no meaning here",
    "a: !!int [b]": ":1: broken YAML: the tag !!int has no meaning here",
    "a: !!map b": ":1: broken YAML: the tag !!map has no meaning here",
    "a: !!timestamp 2020-01-01": ":1: broken YAML: the tag !!timestamp has no meaning here",
    "!!foo a: b": ":1: broken YAML: the tag !!foo has no meaning here",
    "a: {<<: [{b: 1}, 2]}": ":1: broken YAML: only mappings can be merged by <<",
    # Bases.
    "extends: paper/_base\n": ":1: extends: no scenario 'paper/_base': ",
    "extends: 3": ":1: extends: must be a scenario's name or path, or a list of them",
    "extends:": ":1: extends: must be a scenario's name or path, or a list of them",
    "extends: {a: b}": ":1: extends: must be a scenario's name or path, or a list of them",
    "extends: [bad, 3]": ":1: extends: must be a scenario's name or path, or a list of them",
    "extends: paper/k3-fd": ":1: extends: no scenario 'paper/k3-fd': neither a file nor a bundled",
    "\n\nextends: [paper/k3-fdd,\n  nowhere]": ":3: extends: no scenario 'nowhere': neither",
    "extends: bad": ":1: extends: a scenario must not extend itself (bad → bad)",
    "extends: ./bad.yaml": ":1: extends: a scenario must not extend itself (bad → bad)",
    "extends: ''": ":1: extends: no scenario ''",
    'extends: "a\\0b"': ":1: extends: no scenario 'a\\x00b'",
    'extends: "a\\nb"': ":1: extends: no scenario 'a\\nb'",
    f"extends: {'x' * 5000}": ":1: extends: no scenario 'xxx",
}
#: What stands below `extends: paper/k3-fdd`, and what follows `bad.yaml:2: `.
LINES = {
    # Keys.
    "agee: {initial: 2}": "agee: unknown key; did you mean 'age'?",
    "age: {inital: 2}": "age.inital: unknown key; did you mean 'initial'?",
    "age: {xyz: 2}": "age.xyz: unknown key (known: initial, maximum, sampling)",
    "duplex: {beta_min: 0.2}": "duplex.beta_min: unknown key of kind 'fdd': it belongs to kind ",
    "channel: {absorption: {ph: 8}}": (
        "channel.absorption.ph: unknown key of kind 'thorp': it belongs to kind 'francois_"
    ),
    "channel: {wind_m_per_s: 3}": (
        "channel.wind_m_per_s: unknown key of kind 'table': it belongs to kind 'sonar'"
    ),
    "reward: {kind: mean_age, age_weight: 3}": (
        "reward.age_weight: unknown key of kind 'mean_age': it belongs to kind 'paper'"
    ),
    "reward: {fairness_weight: 3}": (
        "reward.fairness_weight: unknown key of kind 'paper': it belongs to kind 'mean_age'"
    ),
    "power_w: 3": "power_w: unknown key; did you mean 'charging.power_w'?",
    "grid: {power_w: 3}": "grid.power_w: unknown key; did you mean 'charging.power_w'?",
    "channel: {noise: 3}": "channel.noise: unknown key; did you mean 'noise_level_db'?",
    "auvs: {speed: 3}": "auvs.speed: unknown key; did you mean 'speed_m_per_s'?",
    "uplink: {bandwith: 3}": "uplink.bandwith: unknown key; did you mean 'bandwidth_hz'?",
    "current: {kind: file, path: x}": "current.path: unknown key (known: file, kind, ",
    "current: {kind: gauss_markov, mean_m_per_s: 3}": (
        "current.mean_m_per_s: unknown key (known: kind, sigma_m_per_s, "
    ),
    "channel: {kind: sonar, wind: {kind: gauss_markov, sigma: 3}}": (
        "channel.wind.sigma: unknown key; did you mean 'sigma_m_per_s'?"
    ),
    "uplink: {kind: modem, loss: {kind: table, table: x.csv}}": (
        "uplink.loss.table: unknown key (known: "
    ),
    "reward: {kind: mean_age, wieght: 3}": "reward.wieght: unknown key (known: credit, fairness_w",
    "noise: 3": "noise: unknown key (known: age, ",
    "grid: {powr_w: 3}": "grid.powr_w: unknown key (known: cells, origin, ",
    "count: 3": "count: unknown key; did you mean 'nodes.count' or 'auvs.count'?",
    "powr_w: 3": "powr_w: unknown key; did you mean 'charging.power_w'?",
    "age.maximum: 3": "age.maximum: unknown key: in a file it is written age: {maximum: …}",
    "age: {extends: paper/k3-fdd}": "age.extends: unknown key: extends stands at the top of a fil",
    "3: 4": "3 is no key: keys are words",
    "null: 4": "null is no key: keys are words",
    "? [a, b]\n: 4": "a list is no key: keys are words",
    '"a\\nb\\e[31m": 4': "a\\nb\\x1b[31m: unknown key",
    # Kinds.
    "reward: {kind: mean_aoi}": "reward.kind: unknown kind 'mean_aoi'; did you mean 'mean_age'?",
    "reward: mean_aoi": "reward: unknown kind 'mean_aoi'; did you mean 'mean_age'?",
    "duplex: {kind: 3}": "duplex.kind: unknown kind '3'; known: fdd, tdd",
    "duplex: {kind: [fdd]}": "duplex.kind: unknown kind",
    "duplex: {kind: null}": "duplex.kind: ",
    "nodes: null": "nodes: must be a mapping of keys to values, not null",
    "observation: {kind: papr}": "observation.kind: unknown kind 'papr'; did you mean 'paper'?",
    "nodes: {kind: random, count: 3, redraw: never}": "nodes.redraw: unknown value 'never' (known",
    # Types.
    "age: 3": "age: must be a mapping of keys to values, not 3",
    "age: [3]": "age: must be a mapping of keys to values, not [3]",
    "age: !x y": "broken YAML: the tag !x has no meaning here",
    "age: !!binary aGk=": "broken YAML: the tag !!binary has no meaning here",
    "training: 3": "training: must be a mapping of keys to values, not 3",
    "age: {initial: x}": "age.initial: must be a valid integer, not 'x'",
    "age: {initial: '2'}": (
        "age.initial: must be a valid integer, not '2'; write it without quotes: 2"
    ),
    "age: {initial: 1.5}": "age.initial: must be a valid integer, not 1.5",
    "age: {initial: true}": "age.initial: must be a valid integer, not true",
    "age: {initial: 2020-01-01}": "age.initial: must be a valid integer, not '2020-01-01'",
    "charging: {power_w: 2kW}": (
        "charging.power_w: must be a valid number, not '2kW'; write the number alone: its unit is"
    ),
    "charging: {power_w: '1e-3'}": (
        "charging.power_w: must be a valid number, not '1e-3'; write it without quotes: 1e-3"
    ),
    "charging: {power_w: nan}": (
        "charging.power_w: must be a valid number, not 'nan'; it must be finite"
    ),
    "observation: {time: yes}": (
        "observation.time: must be a valid boolean, not 'yes'; did you mean true?"
    ),
    "observation: {time: NO}": (
        "observation.time: must be a valid boolean, not 'NO'; did you mean false?"
    ),
    "observation: {time: off}": (
        "observation.time: must be a valid boolean, not 'off'; did you mean false?"
    ),
    "observation: {time: 1}": (
        "observation.time: must be a valid boolean, not 1; did you mean true?"
    ),
    "observation: {time: 'true'}": (
        "observation.time: must be a valid boolean, not 'true'; did you mean true?"
    ),
    "charging: {power_w: }": "charging.power_w: must be a valid number, not null",
    "name: 3": 'name: must be a valid string, not 3; write it in quotes: "3"',
    "name: true": 'name: must be a valid string, not true; write it in quotes: "true"',
    f"name: {'x' * 10_001}": "name: must have at most 10,000 characters, not 10,001",
    "training: {preset: null}": "training.preset: must be a word",
    'name: "\\ud800"': "name: holds half a character",
    "description: [x]": "description: must be a valid string, not ['x']",
    "nodes: {cells: 3}": "nodes.cells: must be a list, not 3",
    "nodes: {cells: [3]}": "nodes.cells[0]: must be a list, not 3",
    "nodes: {cells: {a: 1}}": "nodes.cells: must be a list, not {'a': 1}",
    "nodes: {cells: []}": "nodes.cells: must list at least 1, not 0",
    "training: {hidden_units: 64}": "training.hidden_units: must be a list, not 64",
    # Numbers.
    "charging: {power_w: .nan}": "charging.power_w: must be a finite number, not nan",
    "charging: {power_w: .inf}": "charging.power_w: must be a finite number, not inf",
    "charging: {power_w: 1e999}": "charging.power_w: must be a finite number, not inf",
    "charging: {power_w: -1}": "charging.power_w: must be greater than 0, not -1",
    "charging: {power_w: 0}": "charging.power_w: must be greater than 0, not 0",
    "charging: {efficiency: 1.1}": "charging.efficiency: must be less than or equal to 1, not 1.1",
    "age: {initial: -1}": "age.initial: must be greater than or equal to 1, not -1",
    "age: {initial: 51}": "age.initial: must not exceed age.maximum, 50",
    f"age: {{maximum: {10**30}}}": "age.maximum: must be less than or equal to 10",
    f"age: {{maximum: {hex(10**5000)}}}": "age.maximum: must be less than or equal to 10",
    "uplink: {packet_bits: -100}": "uplink.packet_bits: must be greater than 0, not -100",
    "training: {entropy_coefficient: -1}": "training.entropy_coefficient: must be greater than",
    "training: {discount: 1.01}": "training.discount: must be less than or equal to 1, not 1.01",
    "training: {minibatches: 999999}": "training.minibatches: must not exceed the ",
    "training: {environments: 1, rollout_slots: 1, minibatches: 1}": (
        "training.rollout_slots: must give a rollout of 2 samples or more"
    ),
    "episode: {duration_s: 20}": "episode.duration_s: must hold at least one slot of 25 s",
    "episode: {slot_s: 0}": "episode.slot_s: must be greater than 0, not 0",
    "episode: {slot_s: 1e6}": "episode.slot_s: 1e+06 s is implausible: usual are ",
    "episode: {slot_s: 60, duration_s: 50}": (
        "episode.duration_s: must hold at least one slot of 60 s"
    ),
    "episode: {slot_s: 1, duration_s: 20}": (
        "episode.duration_s: must be as long as a move to the next cell, 25 s (auvs.speed_m_per_s: "
    ),
    "grid: {spacing_m: [100, 20]}": "grid.spacing_m[2]: is missing",
    "grid: {spacing_m: [1, 2, 3, 4]}": "grid.spacing_m: must list at most 3, not 4",
    "grid: {spacing_m: [100, 100, 0]}": "grid.spacing_m[2]: must be greater than 0, not 0",
    "grid: {spacing_m: [100, [1], 3]}": "grid.spacing_m[1]: must be a valid number, not [1]",
    "grid: {spacing_m: wide}": "grid.spacing_m: must be a valid number, not 'wide'",
    "grid: {spacing_m: '100'}": "grid.spacing_m: must be a valid number, not '100'; write it with",
    "grid: {spacing_m: {x: 100}}": "grid.spacing_m: must be a valid number, not {'x': 100}",
    "grid: {spacing_m: [100, 100, 1e5]}": "grid.spacing_m[2]: 100000 m is implausible: usual are ",
    "grid: {own_cell_distance: means}": (
        "grid.own_cell_distance: unknown value 'means'; did you mean 'mean'?"
    ),
    f"vehicle: {HULL}": (
        "vehicle.capacity_j: unknown key of kind 'unlimited': it belongs to kind 'battery'"
    ),
    f"vehicle: {HULL | {'kind': 'battery', 'capacity_j': 1.0}}": (
        "vehicle.capacity_j: the battery does not last one slot: it has 1 J, and a slot of 25 s "
        "takes 1e+03 J of hotel load and 2.11e+04 J at least for a move"
    ),
    f"vehicle: {HULL | {'kind': 'battery', 'initial_share': 0.001}}": (
        "vehicle.initial_share: the battery does not last one slot: it has 1e+03 J, "
    ),
    f"vehicle: {HULL | {'kind': 'battery', 'dock_power_w': 99, 'docks': [[1, 99, 1]]}}": (
        "vehicle.docks[0]: cell [1, 99, 1] lies outside the grid of "
    ),
    f"vehicle: {HULL | {'kind': 'battery', 'docks': [[1, 1, 1]]}}": (
        "vehicle.dock_power_w: must be above vehicle.hotel_w, 40 W: else no dock recharges"
    ),
    f"vehicle: {HULL | {'kind': 'battery', 'hotel_w': -1}}": (
        "vehicle.hotel_w: must be greater than or equal to 0, not -1"
    ),
    "observation: {kind: paper, entries: [battery]}": (
        "observation.entries: battery: there is none with vehicle 'unlimited'"
    ),
    "hearing: polling": "hearing.max_nodes_per_slot: is missing",
    "hearing: {kind: polling, max_nodes_per_slot: 0}": (
        "hearing.max_nodes_per_slot: must be greater than or equal to 1, not 0"
    ),
    "hearing: {kind: polling, max_nodes_per_slot: 2}": (
        "hearing.kind: 'polling' needs packets that take a time of their own"
    ),
    "hearing: {kind: several}": "hearing.kind: unknown kind 'several'; known: one, polling",
    "storage: capacitor": "storage.capacity_j: is missing",
    "storage: {kind: capacitor}": "storage.capacity_j: is missing",
    "storage: {kind: battery, capacity_j: 5}": (
        "storage.kind: unknown kind 'battery'; known: capacitor, unlimited; "
    ),
    "storage: {capacity_j: 5}": (
        "storage.capacity_j: unknown key of kind 'unlimited': it belongs to kind 'capacitor'"
    ),
    "storage: {kind: capacitor, capacity_j: 0}": "storage.capacity_j: must be greater than 0, not ",
    "storage: {kind: capacitor, capacity_j: 1e12}": "storage.capacity_j: 1e+12 J is implausible: ",
    "storage: {kind: capacitor, capacity_j: 5, idle_w: -1}": (
        "storage.idle_w: must be greater than or equal to 0, not -1"
    ),
    "storage: {kind: capacitor, capacity_j: 5, initial_j: 6}": (
        "storage.initial_j: must not exceed storage.capacity_j, 5"
    ),
    "grid: {spacing_m: 1e-320}": "grid.spacing_m: must be 0 or of a size from 1e-15 to 1e+15, not",
    "charging: {power_w: 1e300}": "charging.power_w: must be 0 or of a size from 1e-15 to 1e+15, n",
    "reward: {age_weight: -1e20}": "reward.age_weight: must be 0 or of a size from 1e-15 to 1e+15",
    "nodes: {weights: [5e307, 1, 1]}": "nodes.weights[0]: must be 0 or of a size from 1e-15 to 1e+",
    "charging: {directivity_index_db: 5000}": (
        "charging.directivity_index_db: must be less than or equal to 300, not 5000"
    ),
    "episode: {duration_s: 1e12}\nallow_implausible: [episode.duration_s]": (
        "episode.duration_s: must hold at most 1,000,000,000 slots of 25 s (grid.spacing_m: "
    ),
    # Sizes.
    "grid: {cells: [10_000_000, 10_000_000, 10_000_000]}": (
        "grid.cells: must be at most 1,000,000 cells, not 10000000 × 10000000 × 10000000"
    ),
    "auvs: {count: 4000}": "auvs.count: must be less than or equal to 1000, not 4000",
    f"nodes: {{cells: {[[1, 1, 1]] * 4001}}}": "nodes.cells: must list at most 4,000, not 4,001",
    f"auvs: {{start_cells: {[[1, 1, 1]] * 1001}}}": "auvs.start_cells: must list at most 1,000, n",
    "training: {hidden_units: [1000000, 1000000]}\nallow_implausible: [training.hidden_units]": (
        "training.hidden_units: make a network of some 1e+12 weights: 1e+10 at most"
    ),
    "training: {environments: 100_000, rollout_slots: 1_000_000}\n"
    "allow_implausible: [training.rollout_slots]": (
        "training.rollout_slots: makes a rollout of some 9e+11 numbers: 1e+11 at most"
    ),
    # Cells.
    "nodes: {cells: [[11, 1, 1], [1, 1, 1], [1, 1, 2]]}": (
        "nodes.cells[0]: cell [11, 1, 1] lies outside the grid of 10 × 10 × 4 cells"
    ),
    "nodes: {cells: [[0, 1, 1]]}": "nodes.cells[0][0]: must be greater than or equal to 1, not 0",
    "nodes: {cells: [[1, 1]]}": "nodes.cells[0][2]: is missing",
    "nodes: {cells: [[1, 1, 1, 1]]}": "nodes.cells[0]: must list at most 3, not 4",
    "nodes: {count: 11}": "nodes.count: is 11, but nodes.cells lists only 10 cells",
    "nodes: {kind: random, count: 401}": "nodes.count: is 401, but the grid has only 400 cells",
    "nodes: {weights: [1, 2]}": "nodes.weights: must list one weight for each of the 3 nodes",
    "nodes: {weights: [1, 2, -3]}": "nodes.weights[2]: must be greater than or equal to 0, not -3",
    "auvs: {start_cells: []}": "auvs.start_cells: must list at least 1, not 0",
    "auvs: {start_cells: [[5, 5, 5]]}": "auvs.start_cells[0]: cell [5, 5, 5] lies outside the gr",
    "auvs: {start_cells: [[1, 1, 1], [1, 1, 1]]}": (
        "auvs.start_cells[1]: cell [1, 1, 1] is the start of two AUVs; each needs one of its own"
    ),
    "auvs: {count: 401}": "auvs.count: is 401, but the grid has only 400 cells",
    "auvs: {count: 0}": "auvs.count: must be greater than or equal to 1, not 0",
    "auvs: {count: 8, separation_cells: 5}": (
        "auvs.count: is 8, but only 7 AUVs find room at auvs.separation_cells, 5"
    ),
    # Across keys.
    "duplex: {kind: tdd, beta_min: 0.9, beta_max: 0.1}": (
        "duplex.beta_min: the bounds must satisfy beta_min < beta_max < 1, not 0.9 and 0.1"
    ),
    "duplex: {kind: tdd, beta_min: 0.1, beta_max: 1}": "duplex.beta_min: the bounds must satisfy",
    "channel: {kind: sonar}\nuplink: {bandwidth_hz: 60e3}": (
        "uplink.bandwidth_hz: the band around 30 kHz must stay above 0 Hz"
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize(("text", "expected"), FILES.items())
def test_bad_file(tmp_path, text, expected):
    (tmp_path / "bad.yaml").write_text(text, encoding="utf-8", errors="surrogateescape")
    assert message("bad.yaml").startswith("bad.yaml" + expected)


@pytest.mark.slow
@pytest.mark.parametrize(("text", "expected"), LINES.items())
def test_bad_value(tmp_path, text, expected):
    (tmp_path / "bad.yaml").write_text("extends: paper/k3-fdd\n" + text, encoding="utf-8")
    line = 2 + text.count("\n") * text.startswith("channel")
    assert message("bad.yaml").startswith(f"bad.yaml:{line}: {expected}")


def test_items_of_lists_have_lines_of_their_own(tmp_path):
    text = "extends: paper/k3-fdd\nnodes:\n  cells:\n  - [1, 1, 1]\n  - [11, 1, 1]\n  - [1, 1, 2]"
    (tmp_path / "bad.yaml").write_text(text)
    assert message("bad.yaml").startswith("bad.yaml:5: nodes.cells[1]: cell [11, 1, 1] lies outsi")


def test_file_that_clashes_with_a_base_is_told_of_the_base():
    found = message("paper/k3-fdd", {"grid.cells": [4, 10, 4]})
    expected = "override grid.cells: grid.cells: set nodes.cells beside it: cell [8, 5, 2] lies out"
    assert found.startswith(expected)
    assert found.endswith("paper.yaml:25)")


def test_a_key_of_ones_own_is_told_what_it_needs_where_only_a_bundled_file_has_it(tmp_path):
    text = "extends: random/k10-fdd\nobservation: {kind: table}\ntraining: {over: [paper/k3-fdd]}"
    (tmp_path / "bad.yaml").write_text(text)
    expected = "bad.yaml:3: training.over: set nodes.redraw beside it: must be episode for training"
    assert message("bad.yaml").startswith(expected)
    (tmp_path / "base.yaml").write_text("extends: random/k10-fdd\nnodes: {redraw: run}")
    (tmp_path / "bad.yaml").write_text(text.replace("random/k10-fdd", "base"))
    found = message("bad.yaml")
    assert found.startswith("base.yaml:2: nodes.redraw: must be episode for training.over")
    assert found.endswith(" (training.over: bad.yaml:3)")


def test_circle_of_three(tmp_path):
    for name, base in ("ab", "bc", "ca"):
        (tmp_path / f"{name}.yaml").write_text(f"extends: {base}")
    expected = "c.yaml:1: extends: a scenario must not extend itself (a → b → c → a)"
    assert message("a.yaml") == expected


def test_fault_in_a_base_is_reported_there(tmp_path):
    (tmp_path / "base.yaml").write_text("extends: paper/k3-fdd\n\nage: {initial: x}")
    (tmp_path / "top.yaml").write_text("extends: base\nage: {maximum: 9}")
    assert message("top.yaml").startswith("base.yaml:3: age.initial: ")


def test_several_faults_are_counted():
    text = message("paper/k3-fdd", {"age.initial": 0, "age.maximum": 0, "grid.spacing_m": 0})
    assert text.endswith("must be greater than 0, not 0 (and 2 more)")


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("paper/k3-fd", "; did you mean 'paper/k3-fdd' or '"),
        ("paper/k3-fd", " or 'paper/k7-fdd' or 'paper/k5-fdd'? (see: iout scenarios)"),
        ("qqq", "no scenario 'qqq': neither a file nor a bundled name (see: iout scenarios)"),
        ("", "no scenario ''"),
        ("missing.yaml", "no scenario 'missing.yaml': neither a file nor a bundled name"),
        ("/missing.yaml", "no scenario '/missing.yaml': neither a file nor a bundled name"),
        ("x" * 5000, "no scenario 'xxx"),
        ("a\0b", "no scenario 'a\\x00b'"),
        ("a\nb", "no scenario 'a\\nb'"),
        (".", "no scenario '.'"),
        ("..", "no scenario '..'"),
        ({}, "mapping: grid: is missing (and 9 more)"),
        ({"extends": 3}, "mapping: extends: must be a scenario's name or path, or a list of them"),
        ({"extends": ["paper/k3-fdd", None]}, "mapping: extends: must be a scenario's name or"),
        ({"extends": "paper/k3-fdd", 3: 4}, "mapping: 3 is no key: keys are words"),
        ({"extends": "paper/k3-fdd", "age": object}, "mapping: age: must be a mapping"),
        ({"extends": "paper/k3-fdd", "age": {"maximum": 0}}, "mapping: age.maximum: must be gre"),
        ({"extends": "paper/k3-fdd", "age": {1: 0}}, "mapping: 1 is no key: keys are words"),
        ({"extends": "paper/k3-fdd", "age.maximum": 3}, "mapping: age.maximum: unknown key: in a"),
        (None, "scenario: must be a name, a path, a mapping or a Scenario, not None"),
        (3, "scenario: must be a name, a path, a mapping or a Scenario, not 3"),
        (["paper/k3-fdd"], "scenario: must be a name, a path, a mapping or a Scenario, not ['pap"),
    ],
)
def test_bad_source(source, expected):
    assert expected in message(source)


def test_folder_is_no_scenario(tmp_path):
    (tmp_path / "folder.yaml").mkdir()
    assert message("folder.yaml") == "no scenario 'folder.yaml': it is a folder"
    assert message(tmp_path).endswith(": it is a folder")


def test_folder_of_a_run_names_the_scenario_in_it(tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "run/scenario.yaml").write_text("extends: paper/k3-fdd")
    expected = "no scenario 'run': it is a folder; did you mean 'run/scenario.yaml'?"
    assert message("run") == expected


@pytest.mark.posix
def test_pipe_is_no_scenario(tmp_path):
    os.mkfifo(tmp_path / "pipe.yaml")
    expected = "no scenario 'pipe': it is a pipe or a device, not a file"
    assert message("pipe") == expected
    assert "it is a pipe or a device, not a file" in message({"extends": "pipe"})


def test_wide_characters(tmp_path):
    (tmp_path / "bad.yaml").write_text("extends: paper/k3-fdd", encoding="utf-16")
    assert message("bad.yaml").endswith("not UTF-8 text, but UTF-16: save it as UTF-8")


@pytest.mark.parametrize(
    "error", [PermissionError(13, "Permission denied"), OSError(5, "I/O error")]
)
def test_unreadable_file(tmp_path, monkeypatch, error):
    (tmp_path / "bad.yaml").write_text("extends: paper/k3-fdd")

    def refuse(*args, **kwargs):
        raise error

    monkeypatch.setattr("pathlib.Path.open", refuse)
    assert message("bad.yaml") == f"bad.yaml: cannot be read: {error.strerror}"


def test_folder_closed_to_the_user(monkeypatch):
    inside = Path.stat

    def refuse(path, **kwargs):
        if "closed" in path.parts:
            raise PermissionError(13, "Permission denied")
        return inside(path, **kwargs)

    monkeypatch.setattr(Path, "stat", refuse)
    expected = "no scenario 'closed/bad.yaml': cannot be read: Permission denied"
    assert message("closed/bad.yaml") == expected


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("age.maximum", "--set age.maximum: must be of the form key=value"),
        ("", "--set : must be of the form key=value"),
        ("=3", "--set =3: must be of the form key=value"),
        (".=3", "--set .=3: the key must be dotted words, such as auvs.count"),
        ("age..maximum=3", "--set age..maximum=3: the key must be dotted words"),
        ("age.maximum=", "--set age.maximum=: age.maximum: must be a valid integer, not null"),
        ("age.maximum=x", "--set age.maximum=x: age.maximum: must be a valid integer, not 'x'"),
        ("age.maximum=[1", "--set age.maximum=[1: broken YAML: "),
        ("age.maximum=3: 4: 5", "--set age.maximum=3: 4: 5: 3 is no key: keys are words"),
        ("age.maximum=a: b: c", "--set age.maximum=a: b: c: broken YAML: mapping values are not"),
        ("age.maximum=2020-99-99", "age.maximum: must be a valid integer, not '2020-99-99'"),
        ("age.maximum=!!foo 3", "--set age.maximum=!!foo 3: broken YAML: the tag !!foo has no mea"),
        ("age.maximum=1.5", "--set age.maximum=1.5: age.maximum: must be a valid integer, not 1.5"),
        ("age.maximun=3", "--set age.maximun=3: age.maximun: unknown key; did you mean 'maximum'?"),
        ("age.maximum.x=3", "--set age.maximum.x=3: age.maximum: must be a valid integer, not {'"),
        ("nodes.cells.0=[1, 1, 1]", "nodes.cells: must be a list"),
        ("extends=paper/k5-fdd", "--set extends=paper/k5-fdd: extends cannot be overridden"),
        (f"age.maximum={'9' * 5000}", "--set age.maximum=99999999999999"),
        ("name=" + "x" * 2_000_000, "...: has more than 1,000,000 characters"),
        ("age={1: 2}", "1 is no key: keys are words"),
        ("age=&a [*a]", "--set age=&a [*a]: broken YAML: nested too deeply, or within itself"),
        ("age\n=3", "age\\n=3"),
        ("auvs.count=401", "--set auvs.count=401: auvs.count: is 401, but the grid has only 400"),
    ],
)
def test_bad_override(override, expected):
    assert expected in message("paper/k3-fdd", [override])


def test_bad_override_by_mapping():
    assert message("paper/k3-fdd", {"age.maximun": 3}).startswith(
        "override age.maximun: age.maximun: unknown key; did you mean 'maximum'?"
    )
    assert message("paper/k3-fdd", {3: 4}) == "override 3: keys are words, such as auvs.count"


@pytest.mark.parametrize("overrides", [3, b"age.maximum=3", [3], [("age.maximum", 3)], 2.5])
def test_overrides_that_are_none(overrides):
    assert "must be " in message("paper/k3-fdd", overrides)


def test_a_key_that_is_called_as_its_kind_is_named():
    for given, expected in (
        ({"kind": "file"}, "current.file: is missing"),
        ({"kind": "file", "file": 3}, "current.file: must be the path of a file"),
        ({"kind": "file", "start_h": 1.0}, "current.file: is missing"),
    ):
        with pytest.raises(InputError, match=re.escape(expected)):
            load_scenario("paper/k3-fdd", {"current": given})
