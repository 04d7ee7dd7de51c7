"""How layers of settings come together: `extends`, overrides, kinds."""

import pytest

from iout_marl import InputError, load_scenario


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Writes files into the working folder; returns the path of the last."""
    monkeypatch.chdir(tmp_path)

    def write(**texts):
        for name, text in texts.items():
            path = tmp_path / f"{name.replace('__', '/')}.yaml"
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8")
        return path

    return write


def test_extends_a_bundled_scenario_by_name(write):
    scenario = load_scenario(write(a="extends: paper/k3-fdd\nage: {maximum: 40}"))
    assert scenario.age.maximum == 40
    assert scenario.age.initial == 1
    assert scenario.num_nodes == 3


def test_chain_is_followed_to_its_end(write):
    path = write(
        a="extends: paper/k3-fdd\nage: {maximum: 40}\nfairness: {minimum_jain: 0.1}",
        b="extends: a\nage: {initial: 2}",
        c="extends: b.yaml\nage: {maximum: 30}",
    )
    scenario = load_scenario(path)
    assert (scenario.age.initial, scenario.age.maximum) == (2, 30)
    assert scenario.fairness.minimum_jain == 0.1


def test_later_bases_lie_over_earlier_ones(write):
    path = write(
        one="age: {maximum: 40, initial: 3}",
        two="age: {maximum: 30}",
        both="extends: [paper/k3-fdd, one, two]",
    )
    assert load_scenario(path).age.maximum == 30
    assert load_scenario(path).age.initial == 3


def test_paths_count_from_the_file_that_names_them(write):
    write(base="extends: paper/k3-fdd\nage: {maximum: 40}", other="age: {maximum: 1}")
    path = write(deep__mine="extends: ../base")
    assert load_scenario(path).age.maximum == 40


def test_absolute_path(write):
    base = write(base="extends: paper/k3-fdd\nage: {maximum: 40}")
    assert load_scenario(write(deep__mine=f"extends: {base}")).age.maximum == 40


def test_same_base_twice_is_no_circle(write):
    path = write(
        base="extends: paper/k3-fdd", one="extends: base", both="extends: [base, one, base]"
    )
    assert load_scenario(path).num_nodes == 3


def test_file_beside_goes_before_a_bundled_name(write):
    write(paper__k3_fdd="")
    write(**{"paper__k3-fdd": "extends: best/k5-fdd"})
    assert load_scenario("paper/k3-fdd").num_nodes == 5


def test_lists_are_replaced_whole(write):
    path = write(a="extends: paper/k3-fdd\nnodes: {cells: [[1, 1, 1]], count: 1}")
    assert load_scenario(path).nodes.cells == ((1, 1, 1),)


@pytest.mark.parametrize(
    "overrides",
    [
        ["age.maximum=40", "auvs.start_cells=[[1, 1, 1], [2, 2, 2]]", "reward.kind=mean_age"],
        {
            "age.maximum": 40,
            "auvs.start_cells": [[1, 1, 1], [2, 2, 2]],
            "reward": {"kind": "mean_age"},
        },
        {"age": {"maximum": 40}, "auvs": {"start_cells": [(1, 1, 1), (2, 2, 2)]},
         "reward.kind": "mean_age"},
    ],
)  # fmt: skip
def test_overrides_as_words_and_as_a_mapping(overrides):
    scenario = load_scenario("paper/k3-fdd", overrides)
    assert scenario.age.maximum == 40
    assert scenario.age.initial == 1
    assert scenario.num_auvs == 2
    assert scenario.reward.kind == "mean_age"


def test_last_override_wins():
    overrides = ["age.maximum=40", "age.maximum=30"]
    assert load_scenario("paper/k3-fdd", overrides).age.maximum == 30


def test_overrides_may_stand_before_the_kind_that_they_belong_to():
    scenario = load_scenario("paper/k3-fdd", ["nodes.count=7", "nodes.kind=random"])
    assert (scenario.nodes.kind, scenario.nodes.count) == ("random", 7)


def test_settings_over_a_kind_as_a_word(write):
    """In overrides, and over a file that names the kind alone; a word replaces a whole part."""
    scenario = load_scenario("paper/k3-fdd", ["reward=mean_age", "reward.fairness_weight=0.5"])
    assert (scenario.reward.kind, scenario.reward.fairness_weight) == ("mean_age", 0.5)
    path = write(a="extends: paper/k3-fdd\nreward: mean_age")
    scenario = load_scenario(path, "reward.fairness_weight=0.5")
    assert (scenario.reward.kind, scenario.reward.fairness_weight) == ("mean_age", 0.5)
    path = write(a="extends: paper/k3-fdd\nreward: maen_age")
    with pytest.raises(InputError, match=r"a\.yaml:2: reward\.kind: unknown kind 'maen_age'"):
        load_scenario(path, "reward.fairness_weight=0.5")


def test_overrides_leave_their_arguments_alone():
    overrides = {"age": {"maximum": 40}}
    source = {"extends": "paper/k3-fdd", "age": {"initial": 2}}
    load_scenario(source, overrides)
    assert overrides == {"age": {"maximum": 40}}
    assert source == {"extends": "paper/k3-fdd", "age": {"initial": 2}}


@pytest.mark.parametrize("number", ["1e-3", "1E-3", "0.001", ".001", "1.0e-3"])
def test_floats_need_no_point(number, write):
    path = write(a=f"extends: paper/k3-fdd\ntraining: {{learning_rate: {number}}}")
    assert load_scenario(path).training.learning_rate == 1e-3
    overrides = [f"training.learning_rate={number}"]
    assert load_scenario("paper/k3-fdd", overrides).training.learning_rate == 1e-3


def test_words_of_yaml_1_1_are_no_booleans():
    with pytest.raises(InputError, match=r"training\.mask_actions: must be a valid boolean"):
        load_scenario("paper/k3-fdd", ["training.mask_actions=yes"])


def test_anchors_and_merges(write):
    path = write(
        a="extends: paper/k3-fdd\n"
        "training: &t {mask_actions: &yes true, normalise_value: *yes, steps: &n 7}\n"
        "age: {maximum: *n}\n"
    )
    scenario = load_scenario(path)
    assert scenario.training.mask_actions is True
    assert scenario.training.normalise_value is True
    assert scenario.age.maximum == 7


def test_byte_order_mark_is_skipped(tmp_path):
    path = tmp_path / "bom.yaml"
    path.write_text("extends: paper/k3-fdd", encoding="utf-8-sig")
    assert load_scenario(path).num_nodes == 3


def test_other_kind_starts_from_its_own_defaults(write):
    base = write(a="extends: paper/k3-tdd\nduplex: {frequency_khz: 50, beta_min: 0.3}")
    scenario = load_scenario(base, {"duplex.kind": "fdd"})
    assert scenario.duplex.charging_frequency_khz == 40
    nodes = load_scenario(base, {"nodes": {"kind": "random", "count": 4}}).nodes
    assert nodes.redraw == "episode"


def test_same_kind_named_again_keeps_the_settings(write):
    base = write(a="extends: paper/k3-tdd\nduplex: {beta_min: 0.3}")
    assert load_scenario(base, {"duplex": {"kind": "tdd", "beta_max": 0.8}}).duplex.beta_min == 0.3


def test_nested_kind_switches_alone():
    scenario = load_scenario(
        "paper/k3-fdd",
        {"channel.spreading_factor": 1.7, "channel.absorption.kind": "francois_garrison"},
    )
    assert scenario.channel.spreading_factor == 1.7
    assert scenario.channel.absorption.temperature_c == 10


def test_key_that_the_other_kind_lacks_is_reported_where_the_kind_was_changed(write):
    path = write(a="extends: paper/k3-fdd\n\nnodes: {kind: random}")
    with pytest.raises(InputError, match=r"^a\.yaml:3: nodes\.count: is missing$"):
        load_scenario(path)


@pytest.mark.parametrize(
    ("key", "kind"),
    [("reward", "mean_age"), ("duplex", "tdd"), ("channel", "sonar"), ("auvs.motion", "hover")],
)
def test_a_part_may_be_written_as_its_kind_alone(key, kind):
    word = load_scenario("paper/k3-fdd", {key: kind})
    assert word == load_scenario("paper/k3-fdd", {key: {"kind": kind}})
    assert word.hash != load_scenario("paper/k3-fdd").hash
