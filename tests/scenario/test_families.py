"""Families: many scenarios in one file, each under a name of its own."""

import re
from pathlib import Path

import pytest

from iout_marl import InputError, bundled_names, load_scenario
from iout_marl.scenario import bundled_root, find_scenario, member_names
from iout_marl.scenario.placeholders import word_of

HEAD = "extends: paper/k10-{duplex}\n"
AXES = """\
  axes:
    nodes.count: [3, 5]
    duplex:
      fdd: {}
      tdd: {duplex.beta_rule: stored, description: "TDD, {nodes.count} nodes"}
"""
MINE = f"{HEAD}age: {{maximum: 9}}\nmatrix:\n  name: k{{nodes.count}}-{{duplex}}\n{AXES}"
MEMBERS = ["k3-fdd", "k3-tdd", "k5-fdd", "k5-tdd"]


@pytest.fixture(autouse=True)
def _working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def mine(tmp_path):
    """A family's file; called with a text, another one of that name."""

    def write(text=MINE, name="mine.yaml"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return path

    write()
    return write


def refusal(source, overrides=()):
    with pytest.raises(InputError) as raised:
        load_scenario(source, overrides)
    return str(raised.value)


# What a family is.


def test_members_are_the_product_of_the_axes(mine):
    assert member_names("mine.yaml") == [f"mine/{name}" for name in MEMBERS]
    for name in MEMBERS:
        scenario = load_scenario(f"mine/{name}")
        assert (scenario.num_nodes, scenario.duplex.kind) == (int(name[1]), name[3:])
        assert scenario.age.maximum == 9
        assert scenario.name == f"mine/{name}"
    assert load_scenario("mine/k3-tdd").duplex.beta_rule.kind == "stored"
    assert load_scenario("mine/k5-tdd").description == "TDD, 5 nodes"


def test_a_member_is_as_a_file_with_its_settings(mine):
    mine("extends: paper/k5-tdd\nage: {maximum: 9}\nduplex: {beta_rule: stored}", "single.yaml")
    assert load_scenario("mine/k5-tdd").hash == load_scenario("single").hash


@pytest.mark.parametrize(
    "source",
    [
        "mine/k5-fdd",
        "mine.yaml/k5-fdd",
        "./mine/k5-fdd",
        "mine/k5-fdd.yaml",
        Path("mine") / "k5-fdd",
        b"mine.yaml/k5-fdd",
    ],
)
def test_a_member_by_any_kind_of_path(mine, source, tmp_path):
    assert load_scenario(source).name == "mine/k5-fdd"
    assert load_scenario(tmp_path / "mine.yaml" / "k5-fdd").num_nodes == 5


def test_overrides_lie_over_a_member(mine):
    assert load_scenario("mine/k3-fdd", "nodes.count=4").num_nodes == 4


def test_short_suffix_and_home_folder(mine, monkeypatch, tmp_path):
    mine(name="short.yml")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert load_scenario("short/k3-fdd").num_nodes == load_scenario("~/mine/k3-fdd").num_nodes


def test_a_file_of_that_name_is_preferred(mine):
    mine("extends: paper/k7-fdd", "mine/k3-fdd.yaml")
    assert load_scenario("mine/k3-fdd").num_nodes == 7
    assert load_scenario("mine.yaml/k3-fdd").num_nodes == 3


def test_a_member_is_extended_by_a_file_a_mapping_and_a_family(mine):
    mine("extends: mine/k3-fdd\nage: {initial: 2}", "top.yaml")
    assert load_scenario("top").age.initial == 2
    assert load_scenario({"extends": "mine.yaml/k5-tdd"}).num_nodes == 5
    mine(
        "extends: mine/k{k}-tdd\nmatrix: {name: 'k{k}', axes: {k: {'3': {}, '5': {}}}}", "two.yaml"
    )
    assert load_scenario("two/k5").hash == load_scenario("mine/k5-tdd").hash


def test_members_may_extend_others_of_their_family(mine):
    mine("extends: deep/base\nmatrix: {axes: {age.maximum: [7, 8]}}", "top.yaml")
    mine("matrix: {axes: {m: {base: {}, other: {}}}}\nextends: ../mine/k3-fdd", "deep/base.yaml")
    mine("extends: ../top/7", "deep/last.yaml")
    assert "deep/base.yaml: is a family" in refusal("top/7")
    mine("extends: deep/base/other\nmatrix: {axes: {age.maximum: [7, 8]}}", "top.yaml")
    assert load_scenario("deep/last").age.maximum == 7


def test_a_circle_of_members(mine):
    mine("extends: circle/{to}\nmatrix: {axes: {to: {a: {}, b: {}}}}", "circle.yaml")
    circle = "circle.yaml:1: extends: a scenario must not extend itself (a → a)"
    assert refusal("circle/a") == circle


def test_values_of_any_scalar_have_names(mine):
    values = "[0.5, 1e-3, 10.0, -2, null, true, word]"
    mine("matrix:\n  name: x{age.maximum}\n  axes:\n    age.maximum: " + values)
    names = ["x0.5", "x0.001", "x10", "x-2", "xnull", "xtrue", "xword"]
    assert member_names("mine") == [f"mine/{name}" for name in names]
    assert (word_of(1e300), word_of(False)) == ("1e+300", "false")
    assert word_of(16**5000) == "a number of too many digits"


def test_a_kind_changes_as_in_any_layer(mine):
    axes = "axes: {where: {here: {}, there: {nodes: {kind: random, count: 12}}}}"
    mine(f"extends: paper/k3-fdd\nnodes: {{count: 4}}\nmatrix: {{{axes}}}")
    assert load_scenario("mine/here").num_nodes == 4
    assert load_scenario("mine/there").nodes.kind == "random"


def test_members_are_left_out_and_changed(mine):
    more = """\
  without: [k5-fdd]
  cases:
    - {when: {nodes.count: 3}, set: {age.initial: 2}}
    - {when: {nodes.count: 3, duplex: tdd}, set: {age: {initial: 3}, description: "only {duplex}"}}
    - {when: {duplex.beta_rule: stored}, set: {fairness.minimum_jain: 0.5}}
"""
    mine(MINE + more)
    assert member_names("mine") == ["mine/k3-fdd", "mine/k3-tdd", "mine/k5-tdd"]
    assert [load_scenario(name).age.initial for name in member_names("mine")] == [2, 3, 1]
    assert load_scenario("mine/k3-tdd").description == "only tdd"
    jain = [load_scenario(name).fairness.minimum_jain for name in member_names("mine")]
    assert jain == [0.85, 0.5, 0.5]
    assert "no member 'k5-fdd'; did you mean 'k5-tdd'?" in refusal("mine/k5-fdd")


def test_texts_that_are_extended_are_left_alone(mine):
    mine("extends: paper/k3-fdd\ndescription: 'all of {them}'", "base.yaml")
    mine("extends: base\nname: 'by {age.maximum}'\nmatrix: {axes: {age.maximum: [7, 8]}}")
    scenario = load_scenario("mine/8")
    assert (scenario.description, scenario.name) == ("all of {them}", "by 8")


def test_a_preset_lies_beside_the_family(mine):
    text = (bundled_root() / "training/fast.yaml").read_text(encoding="utf-8")
    mine(text.replace("epochs: 2", "epochs: 7"), "deep/own.yaml")
    mine(MINE + "training: {preset: own}", "deep/mine.yaml")
    assert load_scenario("deep/mine/k3-fdd").training.epochs == 7


def test_bundled_families_are_listed_by_member():
    assert member_names("paper") == [name for name in bundled_names() if name.startswith("paper/")]
    assert find_scenario("multi/m2-k13-fdd").is_file()
    assert len(list(bundled_root().rglob("*.yaml"))) <= 25


def test_a_file_of_a_bundled_familys_name_does_not_hide_it(mine):
    mine("title: a study, say", "paper.yaml")
    assert load_scenario("paper/k3-fdd").name == "paper/k3-fdd"
    mine(MINE, "paper.yaml")
    assert load_scenario("paper/k3-fdd").age.maximum == 9
    assert load_scenario("paper/k7-fdd").age.maximum == 50
    mine("matrix: [", "paper.yaml")
    assert load_scenario("paper/k3-fdd").age.maximum == 50


# Members that there are not.


def test_a_family_without_a_member_is_answered_by_its_members(mine):
    known = "is a family, name one of its scenarios: mine/k3-fdd, mine/k3-tdd, mine/k5-fdd, mine/"
    for source in ("mine", "mine.yaml"):
        assert refusal(source).startswith(f"mine.yaml: {known}")
    assert f"paper.yaml: {known}".replace("mine/", "paper/")[:60] in refusal("paper")
    assert refusal({"extends": "mine"}).startswith("mapping: extends: mine.yaml: is a family, name")


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("mine/k3-fd", "mine.yaml: no member 'k3-fd'; did you mean 'k3-fdd'?"),
        ("mine.yaml/k3-fd", "mine.yaml: no member 'k3-fd'; did you mean 'k3-fdd'?"),
        ("mine/zzz", "mine.yaml: no member 'zzz' (known: k3-fdd, k3-tdd, k5-fdd, k5-tdd)"),
        ("single/zzz", "single.yaml: is no family: it has no `matrix`"),
        ("paper/zzz", "paper.yaml: no member 'zzz' (known: k10-fdd, "),
        ("broken/zzz", "broken.yaml:1: broken YAML: "),
    ],
)
def test_no_such_member(mine, source, expected):
    mine("extends: paper/k3-fdd", "single.yaml")
    mine("matrix: [", "broken.yaml")
    assert refusal(source).startswith(f"no scenario '{source}': ")
    assert expected in refusal(source)
    where = "mapping: extends: no scenario"
    assert refusal({"extends": source}).startswith(where)


@pytest.mark.parametrize("source", ["single", "broken"])
def test_what_is_no_family_has_no_members(mine, source):
    mine("extends: paper/k3-fdd", "single.yaml")
    mine("matrix: {axes: 3}", "broken.yaml")
    with pytest.raises(InputError, match=rf"^{source}\.yaml:"):
        member_names(source)


# Families that are none: what follows `mine.yaml:` for a text behind the head.

AXIS = "matrix:\n  axes:\n    nodes.count: [3, 5]\n"
BAD = {
    "matrix: 3": "2: matrix: must be a mapping of keys to values, not 3",
    "matrix: {}": "2: matrix.axes: is missing",
    "matrix: {axs: {nodes.count: [3]}}": "2: matrix.axs: unknown key; did you mean 'axes'?",
    "matrix:\n  axes: {}": "3: matrix.axes: must list at least 1, not 0",
    "matrix:\n  axes: [3]": "3: matrix.axes: must be a mapping of keys to values, not [3]",
    "matrix:\n  axes:\n    nodes.count: []": (
        "4: matrix.axes.nodes.count: has no values: give at least one"
    ),
    "matrix:\n  axes:\n    duplex: {}": "4: matrix.axes.duplex: has no values: give at least one",
    "matrix:\n  axes:\n    nodes.count: 3": (
        "4: matrix.axes.nodes.count: must list values of a key, or name values and give their "
        "settings, not 3"
    ),
    "matrix:\n  axes:\n    nodes.count:\n    - 3\n    - 3.0": (
        "6: matrix.axes.nodes.count[1]: lists 3 twice"
    ),
    "matrix:\n  axes:\n    grid.cells: [[9, 9, 9]]": (
        "4: matrix.axes.grid.cells[0]: [9, 9, 9] has no name; write grid.cells: {NAME: {…}}"
    ),
    "matrix:\n  axes:\n    a:\n      b: 3": (
        "5: matrix.axes.a.b: must be a mapping of settings, {} for none, not 3"
    ),
    "matrix:\n  axes:\n    a:\n      b:\n        extends: paper/k3-fdd": (
        "6: matrix.axes.a.b.extends: extends stands at the top of a file, where {axis} is filled in"
    ),
    "matrix:\n  axes:\n    a:\n      b:\n        matrix: {}": (
        "6: matrix.axes.a.b.matrix: matrix stands at the top of a file"
    ),
    "matrix:\n  axes:\n    a:\n      b:\n        age..maximum: 3": (
        "6: the key must be dotted words, such as auvs.count"
    ),
    AXIS
    + "  name: same": "5: matrix.name: two members are called 'same'; tell them apart by {node",
    AXIS + "  name: 'k{nods.count}'": (
        "5: matrix.name: unknown {nods.count} (known: {nodes.count})"
    ),
    AXIS + "  name: k {nodes.count}": "5: matrix.name: makes 'k 3': a name has letters, digits and",
    AXIS + "  name: ../{nodes.count}": "5: matrix.name: makes '../3': a name has letters, digits",
    AXIS + "  name: 3": '5: matrix.name: must be a valid string, not 3; write it in quotes: "3"',
    AXIS + "  without: ['4']": "5: matrix.without[0]: no member '4' (known: 3, 5)",
    AXIS + "  without: ['3', '5']": "5: matrix.without: leaves no member",
    AXIS + "  without: '3'": "5: matrix.without: must be a list, not '3'",
    AXIS + "  cases: 3": "5: matrix.cases: must be a valid list, not 3",
    AXIS + "  cases:\n  - when: {nodes.count: 4}\n    set: {}": (
        "6: cases: when: nodes.count: unknown value 4 (known: 3, 5)"
    ),
    AXIS + "  cases:\n  - when: {}\n    set: {extends: a}": (
        "7: matrix.cases[0].set.extends: extends stands at the top of a file"
    ),
    "matrix: {axes: {a: &a [1,2,3,4,5,6,7,8,9,10], b: *a, c: *a, d: *a}}": (
        "2: matrix.axes: make more than 1,000 members"
    ),
}


@pytest.mark.parametrize(("text", "expected"), BAD.items())
def test_bad_family(mine, text, expected):
    mine(f"extends: paper/k10-fdd\n{text}")
    found = refusal("mine.yaml/3")
    assert found.startswith(("mine.yaml:", "no scenario 'mine.yaml/3': mine.yaml:"))
    assert f"mine.yaml:{expected}" in found
    assert f"mine.yaml:{expected}" in refusal("mine.yaml")


#: Axes, and where what does not fit in a member's settings is found.
BAD_MEMBERS = {
    "nods.count: [3]": "4: nods: unknown key; did you mean 'nodes'?",
    "nodes.count:\n    - 99\n  name: m": "5: nodes.count: is 99, but nodes.cells lists only 10",
    "a:\n      m:\n        age.maximm: 9": "6: age.maximm: unknown key; did you mean 'maximum'?",
    "a:\n      m:\n        age:\n          maximum: x": "7: age.maximum: must be a valid integer",
    "a:\n      m:\n        description: '{c}'": "6: description: unknown {c} (known: {a})",
    "a: {m: {}}\n  cases:\n  - when: {}\n    set:\n      age.maximum: 0": (
        "8: age.maximum: must be greater than or equal to 1, not 0"
    ),
    "a: {m: {}}\n  cases:\n  - 3": "6: cases: each must have the mappings 'when' and 'set'",
    "a: {m: {}}\n  cases:\n  - {when: {}}": "6: cases: each must have the mappings 'when' and",
    "a: {m: {}}\n  cases:\n  - {when: {nods.count: 4}, set: {}}": (
        "6: cases: when: nods.count: unknown key; did you mean 'nodes.count'?"
    ),
    "3: {m: {}}": "4: 3 is no key: keys are words",
}


@pytest.mark.parametrize(("text", "expected"), BAD_MEMBERS.items())
def test_bad_settings_of_a_member(mine, text, expected):
    mine(f"extends: paper/k10-fdd\nmatrix:\n  axes:\n    {text}")
    member = "3" if text.startswith("nods") else "m"
    assert f"mine.yaml:{expected}" in refusal(f"mine/{member}")


#: What no member could have, in a family of whose members none is loaded.
UNSEEN = {
    "matrix: {axes: {auvs.cuont: [1, 2]}}": "auvs.cuont: unknown key; did you mean 'count'?",
    "matrix: {axes: {a: {b: {}, c: {age.maximm: 9}}}}": (
        "age.maximm: unknown key; did you mean 'maximum'?"
    ),
    "matrix: {axes: {a: {b: {}}}, cases: [{when: {a: b}, set: {agee: {}}}]}": (
        "agee: unknown key; did you mean 'age'?"
    ),
    "matrix: {axes: {a: {b: {}}}, cases: [{when: {nods.count: 3}, set: {}}]}": (
        "cases: when: nods.count: unknown key; did you mean 'nodes.count'?"
    ),
    "{agee: {}, matrix: {axes: {a: {b: {}}}}}": "agee: unknown key; did you mean 'age'?",
    "{name: 'k{duplx}', matrix: {axes: {duplex: {fdd: {}}}}}": (
        "name: unknown {duplx} (known: {duplex})"
    ),
    "{extends: ['k{duplx}'], matrix: {axes: {duplex: {fdd: {}}}}}": (
        "extends: unknown {duplx} (known: {duplex})"
    ),
    "matrix: {axes: {a: {b: {description: 'of {x}'}}}}": "description: unknown {x} (known: {a})",
}


@pytest.mark.parametrize(("text", "expected"), UNSEEN.items())
def test_what_no_member_could_have_is_refused_when_the_family_is_read(mine, text, expected):
    mine(text)
    with pytest.raises(InputError, match=re.escape(f"mine.yaml:1: {expected}")):
        member_names("mine")


def test_keys_of_kinds_that_only_a_base_names_are_let_pass(mine):
    axes = "axes: {storage.capacity_j: [5], auvs.motion.kind: [six], duplex.beta_min: [0.1]}"
    mine(f"extends: paper/k3-tdd\nstorage: {{leakage_w: 0}}\nmatrix: {{{axes}}}")
    assert member_names("mine") == ["mine/5-six-0.1"]


def test_placeholders_of_what_is_extended(mine):
    mine(f"extends: paper/k10-{{dplex}}\nmatrix:\n{AXES}")
    expected = "mine.yaml:1: extends: unknown {dplex} (known: {nodes.count}, {duplex})"
    assert refusal("mine/3-fdd") == f"no scenario 'mine/3-fdd': {expected}"


def test_a_matrix_belongs_in_a_file():
    axes = {"axes": {"nodes.count": [3]}}
    expected = "matrix: unknown key: matrix stands at the top of a file"
    assert expected in refusal({"extends": "paper/k3-fdd", "matrix": axes})
    assert expected in refusal("paper/k3-fdd", {"matrix": axes})
    assert expected in refusal("paper/k3-fdd", ["matrix.axes={}"])
