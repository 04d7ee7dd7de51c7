"""The bundled scenarios: all there, all whole, all the same after a round trip."""

import itertools
import re

import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

from iout_marl import World, bundled_names, load_scenario
from iout_marl.scenario import bundled_root, to_yaml
from iout_marl.world import pin_layout

PAPER = [
    f"{family}/k{nodes}-{duplex}"
    for family, nodes, duplex in itertools.product(("best", "paper"), (3, 5, 7, 10), ("fdd", "tdd"))
]
MULTI = [
    "multi/m2-k13-fdd",
    *(
        f"multi/m{auvs}-k{nodes}-{duplex}"
        for auvs, nodes, duplex in itertools.product((1, 2, 3, 4), (10, 20, 50), ("fdd", "tdd"))
    ),
]
RANDOM = [name.replace("best", "random") for name in PAPER if name.startswith("best")]
SEA = ["sea/array", "sea/bay", "sea/bay-tide", "sea/slope"]
PRETRAINED = ["pretrained/fdd", "pretrained/tdd"]
EXPECTED = [*PAPER, *MULTI, *PRETRAINED, *RANDOM, *SEA]


def test_list_is_complete():
    assert sorted(bundled_names()) == sorted(EXPECTED)


@pytest.mark.parametrize("name", PAPER)
def test_is_what_its_name_says(name):
    scenario = load_scenario(name)
    family, _, rest = name.partition("/")
    nodes, _, duplex = rest.partition("-")
    assert scenario.name == name
    assert scenario.num_nodes == int(nodes.removeprefix("k"))
    assert scenario.duplex.kind == duplex
    assert scenario.reward.kind == {"paper": "paper", "best": "mean_age"}[family]
    assert scenario.num_slots == 100
    assert scenario.description


def _numbers(node, key=""):
    """Keys of a YAML file whose values are numbers, or lists of them."""
    for name, value in node.items():
        if isinstance(value, dict):
            yield from _numbers(value, name)
        elif not isinstance(value, str | bool | type(None)):
            yield name


@pytest.mark.parametrize("name", SEA)
def test_of_the_sea_says_where_every_number_is_from(name):
    """Its source in brackets, of those listed above, or that it is assumed or derived."""
    file = bundled_root() / f"{name}.yaml"
    text = file.read_text(encoding="utf-8")
    world = text[: text.index("\nreward:")]
    sources = set(re.findall(r"^#   \[(\w)\] ", text, re.MULTILINE))
    assert "A" in sources
    lines = world.splitlines()
    for key in _numbers(yaml.safe_load(world)):
        at = next(i for i, line in enumerate(lines) if re.search(rf"\b{key}:", line))
        beside = lines[at] if "#" in lines[at] else lines[at - 1]
        found = re.findall(r"\[(\w)\]", beside.partition("#")[2])
        told = set(found) & sources or "paper" in beside
        assert told, f"{key}: {lines[at]}"


@pytest.mark.parametrize("name", MULTI)
def test_of_several_auvs_is_what_its_name_says(name):
    scenario = load_scenario(name)
    auvs, nodes, duplex = name.removeprefix("multi/").split("-")
    assert scenario.name == name
    assert scenario.num_auvs == int(auvs.removeprefix("m"))
    assert scenario.num_nodes == int(nodes.removeprefix("k"))
    assert len(set(scenario.nodes.cells[: scenario.num_nodes])) == scenario.num_nodes
    assert scenario.duplex.kind == duplex
    assert scenario.duplex.kind == "fdd" or scenario.duplex.beta_rule.kind == "stored"
    assert scenario.channel.access.kind == "interference"
    assert scenario.reward.kind == "mean_age"
    assert scenario.num_slots == (55 if nodes == "k13" else 100)
    assert scenario.description


@pytest.mark.parametrize("name", RANDOM)
def test_of_random_layouts_is_the_best_one_elsewhere(name):
    scenario = load_scenario(name)
    best = load_scenario(name.replace("random", "best"))
    first, again, second = (pin_layout(scenario, seed) for seed in (0, 0, 1))
    assert first.nodes == again.nodes != second.nodes
    alike = {"nodes": best.nodes, "name": best.name, "description": best.description}
    assert first.num_nodes == best.num_nodes
    assert first.model_copy(update=alike) == best


def test_layouts_of_several_auvs_begin_with_the_papers():
    paper = load_scenario("paper/k10-fdd").nodes.cells
    assert load_scenario("multi/m4-k50-tdd").nodes.cells[:10] == paper


@pytest.mark.slow
@pytest.mark.parametrize("name", EXPECTED)
def test_has_a_world(name):
    scenario = load_scenario(name)
    assert World(scenario).num_slots == scenario.num_slots


@pytest.mark.slow
@pytest.mark.parametrize("name", EXPECTED)
def test_round_trip_through_yaml(name, tmp_path):
    scenario = load_scenario(name)
    path = tmp_path / "copy.yaml"
    path.write_text(to_yaml(scenario), encoding="utf-8")
    copy = load_scenario(path)
    assert copy == scenario
    assert copy.hash == scenario.hash


@pytest.mark.parametrize(
    "changes",
    [
        {"nodes": {"kind": "random", "count": 4, "redraw": "run", "weights": [1, 0, 2.5, 1e-9]}},
        {"channel": {"kind": "sonar", "absorption": {"kind": "francois_garrison", "ph": 7.7}}},
        {"observation": {"kind": "scaled", "node_positions": True, "action_mask": "info"}},
        {"training.target_kl": 0.015, "training.adam_epsilon": 1e-14},
        {"charging.power_w": 1e-14, "channel.noise_level_db": -0.1},
        {"charging.power_w": 1e9, "allow_implausible": ["grid.spacing_m", "charging.power_w"]},
    ],
)
def test_round_trip_of_every_part(changes, tmp_path):
    scenario = load_scenario("paper/k3-tdd", changes)
    path = tmp_path / "copy.yaml"
    path.write_text(to_yaml(scenario), encoding="utf-8")
    assert load_scenario(path) == scenario


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@example("\x85- #\n\t\r")
@given(st.text(st.characters(exclude_categories=["Cs"]), max_size=200))
def test_any_text_survives_as_description(tmp_path_factory, text):
    scenario = load_scenario("paper/k3-fdd", {"description": text, "name": text})
    path = tmp_path_factory.mktemp("text") / "copy.yaml"
    path.write_text(to_yaml(scenario), encoding="utf-8", newline="")
    assert load_scenario(path) == scenario


@pytest.mark.parametrize("name", ["paper/k3-fdd.yaml", "./paper/k3-fdd"])
def test_other_spellings_of_a_name(name):
    assert load_scenario(name) == load_scenario("paper/k3-fdd")


def test_path_and_scenario_and_mapping_are_sources_too():
    scenario = load_scenario("paper/k3-fdd")
    assert load_scenario(bundled_root() / "paper/k3-fdd.yaml") == scenario
    assert load_scenario(scenario) == scenario
    assert load_scenario({"extends": "paper/k3-fdd", "name": scenario.name}) == scenario
    assert load_scenario({**scenario.model_dump()}) == scenario


def test_file_is_called_by_its_name_without_suffix(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("extends: paper/k3-fdd\n")
    assert load_scenario(path).name == "mine"


def test_scenario_is_immutable():
    scenario = load_scenario("paper/k3-fdd")
    with pytest.raises(ValueError, match="frozen"):
        scenario.name = "other"
