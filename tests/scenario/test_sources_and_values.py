"""What is meant is accepted: sources, overrides, and values of other types than a file's."""

import enum
from pathlib import Path

import numpy as np
import pytest

from iout_marl import InputError, load_scenario
from iout_marl.errors import MAX_MESSAGE
from iout_marl.scenario import bundled_root
from iout_marl.scenario.parts import settings_of

P = "paper/k3-fdd"


@pytest.fixture(autouse=True)
def _working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


class AsPath:
    def __fspath__(self):
        return "mine.yaml"


@pytest.mark.parametrize("source", ["mine", "mine.yaml", Path("mine"), b"mine", AsPath()])
def test_file_by_any_kind_of_path(tmp_path, source):
    (tmp_path / "mine.yaml").write_text("extends: paper/k5-fdd")
    assert load_scenario(source).num_nodes == 5
    assert load_scenario(source).name == "mine"


def test_short_suffix_is_as_good(tmp_path):
    (tmp_path / "mine.yml").write_text("extends: base\nage: {maximum: 9}")
    (tmp_path / "base.yml").write_text("extends: paper/k5-fdd")
    assert load_scenario("mine").num_nodes == load_scenario("mine.yml").num_nodes == 5
    assert load_scenario("paper/k5-fdd.yml").num_nodes == 5
    (tmp_path / "own.yml").write_text((bundled_root() / "training/fast.yaml").read_text())
    assert load_scenario("mine", {"training.preset": "own"}).training.preset == "own"


def test_folder_of_the_user(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    (tmp_path / "home").mkdir()
    (tmp_path / "home/mine.yaml").write_text("extends: ~/base")
    (tmp_path / "home/base.yaml").write_text("extends: paper/k5-fdd")
    assert load_scenario("~/mine").num_nodes == 5
    with pytest.raises(InputError, match="no scenario '~nobody-at-all/mine'"):
        load_scenario("~nobody-at-all/mine")


def test_deleted_working_folder(tmp_path, monkeypatch):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert load_scenario(P).num_nodes == 3
    with pytest.raises(InputError, match=r"fast\.yaml:2: steps: unknown key"):
        load_scenario(bundled_root() / "training/fast.yaml")
    with pytest.raises(InputError, match="no scenario 'mine'"):
        load_scenario("mine")


@pytest.mark.parametrize(
    "overrides",
    ["age.maximum=9", ("age.maximum=9",), iter(["age.maximum=9"]), {"age.maximum": 9}],
)
def test_one_override_in_any_form(overrides):
    assert load_scenario(P, overrides).age.maximum == 9


def test_no_override():
    assert (
        load_scenario(P, None) == load_scenario(P, ()) == load_scenario(P, {}) == load_scenario(P)
    )


class Word(enum.StrEnum):
    TDD = "tdd"


@pytest.mark.parametrize(
    ("key", "value", "plain"),
    [
        ("age.maximum", np.int64(9), 9),
        ("age.maximum", np.uint8(9), 9),
        ("age.maximum", np.float32(9), 9),
        ("age.maximum", np.array(9), 9),
        ("age.maximum", 9.0, 9),
        ("training.steps", 1e6, 1_000_000),
        ("charging.power_w", np.float64(9.5), 9.5),
        ("charging.power_w", np.int32(9), 9.0),
        ("observation.time", np.bool_(True), True),
        ("name", np.str_("x"), "x"),
        ("reward.credit", np.str_("difference"), "difference"),
        ("grid.cells", np.array([10, 10, 5]), (10, 10, 5)),
        ("grid.cells", (10, 10, 5), (10, 10, 5)),
        ("grid.cells", [10.0, np.int8(10), 5], (10, 10, 5)),
        ("nodes.cells", np.array([[1, 2, 3]]), ((1, 2, 3),)),
        ("nodes.weights", np.array([1, 2, 3]), (1, 2, 3)),
        ("training.hidden_units", (np.int64(8),), (8,)),
    ],
)
def test_numbers_and_arrays_of_numpy(key, value, plain):
    section, _, name = key.rpartition(".")
    in_file = {section: {name: value}} if section else {name: value}
    for scenario in (load_scenario(P, {key: value}), load_scenario({"extends": P, **in_file})):
        found = scenario
        for part in key.split("."):
            found = getattr(found, part)
        assert found == plain
        assert type(found) is type(plain)


def test_sections_and_words_of_python():
    nodes = settings_of("placement", {"kind": "fixed", "cells": ((1, 1, 1), (2, 2, 2))})
    scenario = load_scenario(P, {"nodes": nodes, "duplex.kind": Word.TDD})
    assert scenario.num_nodes == 2
    assert scenario.duplex.kind == "tdd"


@pytest.mark.parametrize("number", ["1e6", "1E6", "1_000_000", "1000000.0", "1.0e6"])
def test_whole_numbers_however_they_are_written(tmp_path, number):
    (tmp_path / "mine.yaml").write_text(f"extends: {P}\ntraining: {{steps: {number}}}")
    assert load_scenario("mine").training.steps == 1_000_000
    assert load_scenario(P, f"training.steps={number}").hash == load_scenario("mine").hash


@pytest.mark.parametrize("value", [1.5, np.float64(1.5), 1e300, float("inf"), float("nan"), -1.0])
def test_numbers_that_are_no_count(value):
    with pytest.raises(InputError, match=r"override age\.maximum: age\.maximum: must be "):
        load_scenario(P, {"age.maximum": value})


def endless():
    mapping = {}
    mapping["age"] = mapping
    return mapping


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (endless(), "nested too deeply, or within itself"),
        (np.zeros(10**6), "more than 25,000 values"),
        ([0] * 10**6, "more than 25,000 values"),
        ({1: 2}, "1 is no key: keys are words"),
        (object, "must be a mapping of keys to values, not <class 'object'>"),
        ({3}, "must be a mapping of keys to values, not {3}"),
        (b"x", "must be a mapping of keys to values, not b'x'"),
        (np.array(["a", "b"]), "must be a mapping of keys to values, not ['a', 'b']"),
    ],
)
def test_values_that_no_file_could_hold(value, expected):
    for source, overrides in ((P, {"age": value}), ({"extends": P, "age": value}, ())):
        with pytest.raises(InputError) as raised:
            load_scenario(source, overrides)
        assert expected in str(raised.value)


def test_origins_of_mappings_files_and_overrides(tmp_path):
    (tmp_path / "base.yaml").write_text(f"extends: {P}\n\nage: {{initial: 3}}")
    with pytest.raises(InputError, match=r"^mapping: age\.maximum: must be greater"):
        load_scenario({"extends": "base", "age": {"maximum": 0}})
    with pytest.raises(InputError, match=r"^base\.yaml:3: age\.initial: .* \(age\.maximum: mapp"):
        load_scenario({"extends": "base", "age": {"maximum": 2}})
    with pytest.raises(InputError, match=r"^override age: age\.maximum: must be greater"):
        load_scenario("base", {"age": {"maximum": 0}})
    with pytest.raises(InputError, match=r"^mapping: nodes\.cells\[1\]\[0\]: must be greater"):
        load_scenario({"extends": "base", "nodes": {"cells": [[1, 1, 1], [0, 1, 1]]}})


def test_all_unknown_keys_in_one_line(tmp_path):
    (tmp_path / "mine.yaml").write_text(
        f"extends: {P}\nagee: 3\nreward: {{fairness_weight: 3}}\npower_w: 3\nage: {{xyz: 1}}"
    )
    with pytest.raises(InputError) as raised:
        load_scenario("mine")
    parts = str(raised.value).split("; also ")
    assert sorted(part.partition(": unknown key")[0] for part in parts) == [
        "mine.yaml:2: agee",
        "mine.yaml:3: reward.fairness_weight",
        "mine.yaml:4: power_w",
        "mine.yaml:5: age.xyz",
    ]


@pytest.mark.slow
@pytest.mark.parametrize("section", ["", "training"])
def test_of_many_unknown_keys_some_are_described_and_all_counted(tmp_path, section):
    keys = "".join(f"{' ' * bool(section)}k{i}: 1\n" for i in range(20_000))
    (tmp_path / "mine.yaml").write_text(f"extends: {P}\n{section + ':' * bool(section)}\n{keys}")
    with pytest.raises(InputError) as raised:
        load_scenario("mine")
    assert str(raised.value).endswith("; … and 19,992 more")
    assert len(str(raised.value)) < MAX_MESSAGE


def test_hints_are_sought_only_for_the_keys_described(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(
        "iout_marl.scenario.problems.hint_to_key",
        lambda model, section, own, key, **kwargs: asked.append(key) or "",
    )
    with pytest.raises(InputError):
        load_scenario({"extends": P, **{f"k{i}": 1 for i in range(5000)}})
    assert 0 < len(asked) < 50


def chain(tmp_path, number, line, last=P):
    for i in range(number):
        (tmp_path / f"c{i}.yaml").write_text(line.format(f"c{i + 1}"))
    (tmp_path / f"c{number}.yaml").write_text(f"extends: {last}")


def test_bases_that_double_at_each_level_are_read_once(tmp_path):
    chain(tmp_path, 20, "extends: [{0}, {0}]")
    assert load_scenario("c0").num_nodes == 3


@pytest.mark.slow
@pytest.mark.parametrize(
    "line", ["extends: {}", "extends: [{0}, {0}]", f"extends: [{'{}, ' * 60}]".replace("{}", "{0}")]
)
def test_more_bases_than_anyone_needs(tmp_path, line):
    chain(tmp_path, 2000, line)
    with pytest.raises(InputError, match=r"c\d+\.yaml:1: extends: more than 50 scenarios in all"):
        load_scenario("c0")


@pytest.mark.slow
@pytest.mark.parametrize(
    "text",
    ["'" + "k" * 100_000 + "': 1", "age: {maximum: " + "k" * 100_000 + "}", "x" * 100_000]
    + [f"age: {{{'k' * 1000}{i}: 1}}" for i in range(2)]
    + ["extends: " + "k" * 100_000, "age: &" + "a" * 100_000 + " !" + "b" * 100_000 + " c"]
    + ["training: {preset: " + "k" * 100_000 + "}", "nodes: {kind: " + "k" * 100_000 + "}"]
    + ["age: {maximum: 0x" + "f" * 100_000 + "}", "%YAML " + "1" * 100_000 + "\n---\na: 1"]
    + ["allow_implausible: [" + "k" * 100_000 + "]", "'a" + ".b" * 10_000 + "': 1"]
    + ['age: {"' + "\\ud800" * 1000 + '": 1}', '"' + "\\e" * 10_000 + '": 1'],
)
def test_messages_are_one_line_of_bounded_length(tmp_path, text):
    (tmp_path / "mine.yaml").write_text(
        f"{text}\n" if "extends" in text else f"extends: {P}\n{text}"
    )
    with pytest.raises(InputError) as raised:
        load_scenario("mine")
    assert str(raised.value).isprintable()
    assert len(str(raised.value)) <= MAX_MESSAGE


def test_long_overrides_are_cut_in_messages():
    for overrides in (["a" * 10**5 + "=1"], ["a" + ".a" * 10**5 + "=1"], {"a" * 10**5: 1}):
        with pytest.raises(InputError) as raised:
            load_scenario(P, overrides)
        assert len(str(raised.value)) <= MAX_MESSAGE
