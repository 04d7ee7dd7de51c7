"""Bad input is answered by one line: file, line, key, and what was meant."""

from pathlib import Path

import pytest

from iout_marl import InputError, load_scenario


@pytest.fixture(autouse=True)
def _working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def message(source, overrides=()):
    with pytest.raises(InputError) as raised:
        load_scenario(source, overrides)
    text = str(raised.value)
    assert text.isprintable(), "not one line"
    return text


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
    "": ": grid: is missing (and 9 more)",
    "# nothing\n": ": grid: is missing (and 9 more)",
    "null": ": grid: is missing (and 9 more)",
    "- a\n- b\n": ":1: must be a mapping of keys to values",
    "5": ":1: must be a mapping of keys to values",
    "just words": ":1: must be a mapping of keys to values",
    # Scalars that ruamel.yaml itself stumbles over.
    "name: 2020-99-99": ": broken YAML: month must be in 1..12",
    "name: !!int x": ": broken YAML: invalid literal",
    "name: 0x_": ": broken YAML: ",
    "name: " + "9" * 5000: ": broken YAML: Exceeds the limit",
    # Without end.
    "&a\nx: *a": ": broken YAML: nested too deeply, or within itself",
    "x: " + "[" * 1000: ": broken YAML: nested too deeply, or within itself",
    "a: &a [1,1,1,1,1,1,1,1]\n"
    + "".join(
        f"{key}: &{key} [{','.join([f'*{chr(ord(key) - 1)}'] * 8)}]\n" for key in "bcdefghi"
    ): (": broken YAML: more than 100,000 values"),
    # Bases.
    "extends: paper/_base\n": ": duplex: is missing",
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
    "age: {xyz: 2}": "age.xyz: unknown key (known: initial, maximum)",
    "duplex: {beta_min: 0.2}": "duplex.beta_min: unknown key (known: charging_frequency_khz, kind",
    "channel: {absorption: {ph: 8}}": "channel.absorption.ph: unknown key (known: kind)",
    "3: 4": "3 is no key: keys are words",
    "null: 4": "None is no key: keys are words",
    "? [a, b]\n: 4": "('a', 'b') is no key: keys are words",
    '"a\\nb\\e[31m": 4': "a\\nb\\x1b[31m: unknown key",
    # Kinds.
    "reward: {kind: mean_aoi}": "reward.kind: unknown kind 'mean_aoi'; did you mean 'mean_age'?",
    "duplex: {kind: 3}": "duplex.kind: unknown kind '3' (known: fdd, tdd)",
    "duplex: {kind: [fdd]}": "duplex.kind: unknown kind",
    "duplex: {kind: null}": "duplex.kind: ",
    "nodes: null": "nodes: must be a mapping of keys to values, not None",
    "observation: {kind: papr}": "observation.kind: unknown value 'papr'; did you mean 'paper'?",
    "nodes: {kind: random, count: 3, redraw: never}": "nodes.redraw: unknown value 'never' (known",
    # Types.
    "age: 3": "age: must be a mapping of keys to values, not 3",
    "age: [3]": "age: must be a mapping of keys to values, not [3]",
    "age: !x y": "age: must be a mapping of keys to values, not TaggedScalar",
    "age: !!binary aGk=": "age: must be a mapping of keys to values, not b'hi'",
    "training: 3": "training: must be a mapping of keys to values, not 3",
    "age: {initial: x}": "age.initial: must be a valid integer, not 'x'",
    "age: {initial: '2'}": "age.initial: must be a valid integer, not '2'",
    "age: {initial: 1.5}": "age.initial: must be a valid integer, not 1.5",
    "age: {initial: true}": "age.initial: must be a valid integer, not True",
    "age: {initial: 2020-01-01}": "age.initial: must be a valid integer, not datetime.date",
    "charging: {power_w: 2kW}": "charging.power_w: must be a valid number, not '2kW'",
    "charging: {power_w: }": "charging.power_w: must be a valid number, not None",
    "name: 3": "name: must be a valid string, not 3",
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
    "training: {minibatches: 99999}": "training.minibatches: must not exceed the ",
    "training: {environments: 1, rollout_slots: 1, minibatches: 1}": (
        "training.rollout_slots: must give a rollout of 2 samples or more"
    ),
    "episode: {duration_s: 20}": "episode.duration_s: must hold at least one slot of 25 s",
    "grid: {spacing_m: 1e-320}": "grid.spacing_m: makes slots too short to be counted",
    "grid: {spacing_m: 5e-324}": "grid.spacing_m: makes slots too short to be counted",
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
    # Across keys.
    "duplex: {kind: tdd, beta_min: 0.9, beta_max: 0.1}": (
        "duplex.beta_min: the bounds must satisfy beta_min < beta_max < 1, not 0.9 and 0.1"
    ),
    "duplex: {kind: tdd, beta_min: 0.1, beta_max: 1}": "duplex.beta_min: the bounds must satisfy",
    "channel: {kind: sonar}\nuplink: {bandwidth_hz: 60e3}": (
        "uplink.bandwidth_hz: the band around 30 kHz must stay above 0 Hz"
    ),
}


@pytest.mark.parametrize(("text", "expected"), FILES.items())
def test_bad_file(tmp_path, text, expected):
    (tmp_path / "bad.yaml").write_text(text, encoding="utf-8", errors="surrogateescape")
    assert message("bad.yaml").startswith("bad.yaml" + expected)


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
    assert "_base.yaml:12: nodes.cells[1]: cell [8, 5, 2] lies outside the grid of 4 × 10 × 4" in (
        message("paper/k3-fdd", {"grid.cells": [4, 10, 4]})
    )


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
        ("paper/k3-fd", "; did you mean 'paper/k3-fdd'?"),
        ("qqq", "(known: best/k10-fdd, best/k10-tdd, best/k3-fdd, "),
        ("", "no scenario ''"),
        ("missing.yaml", "no scenario 'missing.yaml': neither a file nor a bundled name"),
        ("/missing.yaml", "no scenario '/missing.yaml': neither a file nor a bundled name"),
        ("x" * 5000, "no scenario 'xxx"),
        ("a\0b", "no scenario 'a\\x00b'"),
        ("a\nb", "no scenario 'a\\nb'"),
        (".", "no scenario '.'"),
        ("..", "no scenario '..'"),
        ({}, "scenario: grid: is missing (and 9 more)"),
        ({"extends": 3}, "scenario: extends: must be a scenario's name or path, or a list of them"),
        ({"extends": ["paper/k3-fdd", None]}, "scenario: extends: must be a scenario's name or"),
        ({"extends": "paper/k3-fdd", 3: 4}, "scenario: [3]: unknown key"),
        ({"extends": "paper/k3-fdd", "age": object}, "scenario: age: must be a mapping"),
    ],
)
def test_bad_source(source, expected):
    assert expected in message(source)


def test_folder_is_no_scenario(tmp_path):
    (tmp_path / "folder.yaml").mkdir()
    assert "no scenario 'folder.yaml'" in message("folder.yaml")


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
    inside = Path.is_file

    def refuse(path):
        if "closed" in path.parts:
            raise PermissionError(13, "Permission denied")
        return inside(path)

    monkeypatch.setattr(Path, "is_file", refuse)
    assert "no scenario 'closed/bad.yaml'" in message("closed/bad.yaml")


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("age.maximum", "--set age.maximum: must be of the form key=value"),
        ("", "--set : must be of the form key=value"),
        ("=3", "--set =3: must be of the form key=value"),
        (".=3", "--set .=3: the key must be dotted words, such as auvs.count"),
        ("age..maximum=3", "--set age..maximum=3: the key must be dotted words"),
        ("age.maximum=", "--set age.maximum=: age.maximum: must be a valid integer, not None"),
        ("age.maximum=x", "--set age.maximum=x: age.maximum: must be a valid integer, not 'x'"),
        ("age.maximum=[1", "--set age.maximum=[1: broken YAML: "),
        ("age.maximum=3: 4: 5", "--set age.maximum=3: 4: 5: broken YAML: "),
        ("age.maximum=2020-99-99", "--set age.maximum=2020-99-99: broken YAML: month must be"),
        ("age.maximum=1e3", "--set age.maximum=1e3: age.maximum: must be a valid integer, not 10"),
        ("age.maximun=3", "--set age.maximun=3: age.maximun: unknown key; did you mean 'maximum'?"),
        ("age.maximum.x=3", "--set age.maximum.x=3: age.maximum: must be a valid integer, not {'"),
        ("nodes.cells.0=[1, 1, 1]", "nodes.cells: must be a list"),
        ("extends=paper/k5-fdd", "--set extends=paper/k5-fdd: extends: unknown key"),
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
