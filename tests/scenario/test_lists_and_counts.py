"""A list and the number of its entries that are meant, in one layer or in two."""

import itertools

import pytest

from iout_marl import InputError, load_scenario

#: Section, its list, and the number of nodes or AUVs.
PAIRS = {
    "nodes": ("cells", lambda scenario: scenario.num_nodes),
    "auvs": ("start_cells", lambda scenario: scenario.num_auvs),
}
FIVE = [[1, 1, 1], [2, 2, 2], [3, 3, 3], [4, 4, 4], [5, 5, 1]]


@pytest.fixture
def write(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def write(name, section=None, extends="paper/k3-fdd", **keys):
        lines = [f"extends: {extends}"]
        if section:
            lines.append(f"{section}:")
            lines += [f"  {key}: {value}" for key, value in keys.items()]
        (tmp_path / f"{name}.yaml").write_text("\n".join(lines))
        return name

    return write


@pytest.fixture(params=PAIRS)
def section(request):
    return request.param


def load(section, source, overrides=()):
    return PAIRS[section][1](load_scenario(source, overrides))


def test_count_follows_a_list_above_it(write, section):
    write("counts", section, count=2)
    listed = PAIRS[section][0]
    assert load(section, write("lists", section, extends="counts", **{listed: FIVE})) == 5
    assert load(section, write("over", extends="lists")) == 5


def test_count_follows_a_list_of_a_later_base(write, section):
    write("counts", section, count=2)
    write("lists", section, **{PAIRS[section][0]: FIVE})
    assert load(section, write("both", extends="[counts, lists]")) == 5
    assert load(section, write("turned", extends="[lists, counts]")) == 2


def test_count_follows_a_list_in_an_override(write, section):
    source, listed = write("counts", section, count=2), PAIRS[section][0]
    assert load(section, source, [f"{section}.{listed}={FIVE}"]) == 5
    assert load(section, source, {section: {listed: FIVE}}) == 5
    assert load(section, load_scenario(source), {f"{section}.{listed}": FIVE}) == 5
    assert load(section, {"extends": source, section: {listed: FIVE}}) == 5


def test_a_count_of_auvs_that_goes_on_beyond_a_list_above_it_is_kept(write):
    write("counts", "auvs", count=7)
    source = write("lists", "auvs", extends="counts", start_cells=FIVE)
    assert load("auvs", source) == 7
    assert load_scenario(source).auvs.start_cells[0] == (1, 1, 1)
    assert load("auvs", "multi/m4-k10-fdd", {"auvs.start_cells": [[2, 2, 1]]}) == 4


def test_count_above_its_list_is_kept(write, section):
    write("lists", section, **{PAIRS[section][0]: FIVE})
    assert load(section, write("counts", section, extends="lists", count=2)) == 2
    assert load(section, "lists", [f"{section}.count=4"]) == 4
    assert load(section, load_scenario("lists"), {f"{section}.count": 4}) == 4


def test_count_beside_its_list_is_kept(write, section):
    listed = PAIRS[section][0]
    assert load(section, write("both", section, **{listed: FIVE, "count": 2})) == 2
    pair = [f"{section}.{listed}={FIVE}", f"{section}.count=2"]
    for overrides in itertools.permutations(pair):
        assert load(section, "paper/k3-fdd", overrides) == 2


def test_null_for_a_count_means_all(write, section):
    write("lists", section, **{PAIRS[section][0]: FIVE}, count=2)
    assert load(section, "lists", [f"{section}.count=null"]) == 5


@pytest.mark.parametrize("names", [("lists", "counts"), ("one", "one")])
def test_a_count_larger_than_its_list_names_both_places(write, names):
    lists, counts = names
    if lists == counts:
        source = write("one", "nodes", cells=FIVE, count=6)
        expected = (
            "one.yaml:4: nodes.count: is 6, but nodes.cells lists only 5 cells "
            "(nodes.cells: one.yaml:3)"
        )
    else:
        write("lists", "nodes", cells=FIVE)
        source = write("counts", "nodes", extends="lists", count=6)
        expected = (
            "counts.yaml:3: nodes.count: is 6, but nodes.cells lists only 5 cells "
            "(nodes.cells: lists.yaml:3)"
        )
    with pytest.raises(InputError) as raised:
        load_scenario(source)
    assert str(raised.value) == expected


def test_weights_that_do_not_fit_an_inherited_count_name_both_places(write):
    write("counts", "nodes", count=2)
    source = write("weighs", "nodes", extends="counts", weights=[1, 2, 3])
    with pytest.raises(InputError) as raised:
        load_scenario(source)
    assert str(raised.value) == (
        "weighs.yaml:3: nodes.weights: must list one weight for each of the 2 nodes, not 3 "
        "(nodes.count: counts.yaml:3)"
    )


@pytest.mark.parametrize(
    ("override", "place"),
    [
        ("nodes.count=2", "nodes.count: --set nodes.count=2"),
        (f"nodes.cells={FIVE}", f"nodes.cells: --set nodes.cells={FIVE}"),
        ("nodes={kind: random, count: 2, weights: [1]}", ""),
    ],
)
def test_inherited_weights_that_no_longer_fit_name_both_places(write, override, place):
    source = write("weighs", "nodes", weights=[1, 2, 3])
    with pytest.raises(InputError, match=r"nodes\.weights: must list one weight for each") as e:
        load_scenario(source, [override])
    assert place in str(e.value)


def test_weights_and_cells_of_one_layer_fit_over_a_count(write):
    source = write("whole", "nodes", cells=FIVE, weights=[1, 2, 3, 4, 5])
    assert load_scenario(source).node_weights == (1, 2, 3, 4, 5)


def test_another_kind_forgets_the_list_and_its_count(write):
    write("lists", "nodes", cells=FIVE, count=2)
    scenario = load_scenario("lists", {"nodes": {"kind": "random", "count": 7}})
    assert scenario.num_nodes == 7


def test_preset_counts_the_cells_of_a_scenario_that_lists_them(write):
    source = write("five", "nodes", cells=FIVE)
    changes = {"training.preset": "paper"}
    expected = load_scenario("paper/k5-fdd", changes).training.steps
    assert load_scenario(source, changes).training.steps == expected
