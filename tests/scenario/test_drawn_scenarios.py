"""`training.over`: families of scenarios are read, checked and drawn."""

import numpy as np
import pytest
import yaml

from iout_marl.errors import InputError
from iout_marl.scenario import load_scenario, to_yaml
from iout_marl.scenario.drawing import Families

TABLE = {"observation": {"kind": "table"}, "nodes": {"redraw": "episode"}}
VARY = {
    "nodes.count": {"from": 3, "to": 30, "scale": "log"},
    "grid.cells": [[6, 6, 2], [10, 10, 3]],
    "charging.power_w": {"from": 500, "to": 5000, "scale": "log"},
    "nodes.weights": {"each": {"from": 0.5, "to": 2}},
}


def over(*entries, **changes):
    return load_scenario("random/k5-fdd", {**TABLE, "training.over": list(entries), **changes})


def drawn(families, number, **options):
    rng = np.random.default_rng(3)
    return [families.draw(rng, **options) for _ in range(number)]


def test_without_it_the_scenario_itself_is_drawn_and_its_hash_is_as_it_was():
    scenario = load_scenario("random/k5-fdd")
    (draw,) = drawn(Families.from_scenario(scenario), 1)
    assert draw.scenario == scenario
    assert draw.values == {}
    assert over().hash == load_scenario("random/k5-fdd", TABLE).hash
    assert over({"vary": VARY}).hash != over().hash


@pytest.mark.slow
def test_ranges_and_choices_are_drawn_from_end_to_end():
    draws = drawn(Families.from_scenario(over({"name": "all", "vary": VARY})), 400)
    nodes = [draw.scenario.num_nodes for draw in draws]
    assert all(isinstance(draw.values["nodes.count"], int) for draw in draws)
    assert (min(nodes), max(nodes)) == (3, 30)
    assert np.median(nodes) == pytest.approx(np.sqrt(3 * 30), rel=0.2)
    assert {draw.scenario.grid.cells for draw in draws} == {(6, 6, 2), (10, 10, 3)}
    powers = np.log([draw.scenario.charging.power_w for draw in draws])
    assert powers.min() >= np.log(500)
    assert powers.max() <= np.log(5000)
    assert powers.mean() == pytest.approx(np.log(500 * 5000) / 2, abs=0.15)
    weights = [draw.scenario.nodes.weights for draw in draws]
    assert [*map(len, weights)] == nodes
    assert 0.5 <= min(map(min, weights)) < 0.6
    assert 1.9 < max(map(max, weights)) <= 2


@pytest.mark.slow
def test_whole_numbers_are_drawn_equally_often():
    scenario = over({"vary": {"nodes.count": {"from": 2, "to": 4}}})
    draws = drawn(Families.from_scenario(scenario), 600)
    _, counts = np.unique([draw.scenario.num_nodes for draw in draws], return_counts=True)
    assert len(counts) == 3
    assert counts.min() > 160


def test_the_same_generator_draws_the_same():
    families = Families.from_scenario(over({"vary": VARY}, "multi/m2-k10-fdd"))
    assert drawn(families, 5) == drawn(families, 5)


@pytest.mark.slow
def test_weights_say_how_often_and_strata_which_half():
    entries = ({"name": "a", "weight": 3, "vary": VARY}, {"name": "b"})
    families = Families.from_scenario(over(*entries))
    draws = drawn(families, 400)
    assert sum(draw.name == "a" for draw in draws) == pytest.approx(300, abs=40)
    few, many = (
        [d.scenario.num_nodes for d in drawn(families, 50, family=0, stratum=i)] for i in (0, 1)
    )
    assert max(few) <= min(many)


def test_what_does_not_go_together_is_not_drawn():
    vary = {"nodes.count": {"from": 1, "to": 8}, "grid.cells": [[2, 2, 1], [10, 10, 4]]}
    vary = {**vary, "auvs.start_cells": [[[1, 1, 1]]]}
    changes = {"nodes.count": 3, "auvs.start_cells": [[1, 1, 1]]}
    draws = drawn(Families.from_scenario(over({"vary": vary}, **changes)), 100)
    assert {d.scenario.num_nodes for d in draws if d.scenario.grid.cells[0] == 2} == {1, 2, 3, 4}


def test_other_scenarios_keep_their_world_but_not_their_training_and_observation():
    scenario = over("multi/m2-k10-fdd", **{"training.steps": 12345})
    (draw,) = drawn(Families.from_scenario(scenario), 1)
    assert draw.name == "multi/m2-k10-fdd"
    assert draw.scenario.num_auvs == 2
    assert draw.scenario.training.steps == 12345
    assert not draw.scenario.training.over
    assert draw.scenario.observation == scenario.observation
    assert (
        draw.scenario.world_hash
        == load_scenario("multi/m2-k10-fdd", {"observation.kind": "table"}).world_hash
    )


def test_it_is_written_and_read_back_wherever_the_file_lies(tmp_path):
    other = tmp_path / "mine" / "other.yaml"
    other.parent.mkdir()
    other.write_text("extends: random/k5-fdd\nnodes: {count: 7}\n")
    file = tmp_path / "mine" / "all.yaml"
    entries = ["other.yaml", {"scenario": {"extends": "other.yaml", "nodes": {"count": 8}}}]
    file.write_text(
        yaml.dump(
            {"extends": "random/k5-fdd", **TABLE, "training": {"over": [*entries, {"vary": VARY}]}}
        )
    )
    scenario = load_scenario(file)
    assert [m.base.num_nodes for m in Families.from_scenario(scenario).members] == [7, 8, 5]
    copy = tmp_path / "copy.yaml"
    copy.write_text(to_yaml(scenario))
    other.unlink()
    assert load_scenario(copy) == scenario
    assert load_scenario(copy).hash == scenario.hash


@pytest.mark.parametrize(
    ("entry", "where", "message"),
    [
        ({"vary": {"nodes.cont": [1]}}, ".vary.nodes.cont", "did you mean 'nodes.count'?"),
        ({"vary": {"nodes.count": 3}}, ".vary.nodes.count", "must be a list of choices or"),
        ({"vary": {"nodes.count": []}}, ".vary.nodes.count", "at least one"),
        ({"vary": {"nodes.count": {"from": 3}}}, ".vary.nodes.count.to", "is missing"),
        ({"vary": {"nodes.count": {"from": 3, "up": 4}}}, ".vary.nodes.count.up", "unknown key"),
        ({"vary": {"nodes.count": {"from": 5, "to": 3}}}, ".vary.nodes.count.to", "below from"),
        ({"vary": {"nodes.count": {"from": 0, "to": 3}}}, ".vary.nodes.count.from", "not 0"),
        ({"vary": {"nodes.count": {"from": 3, "to": 500}}}, ".vary.nodes.count.to", "400 cells"),
        (
            {"vary": {"nodes.count": {"from": 3, "to": 4.5}}},
            ".vary.nodes.count.to",
            "valid integer",
        ),
        ({"vary": {"grid.cells": [[9, 9, 9], [1, 1]]}}, ".vary.grid.cells[1]", "is missing"),
        ({"vary": {"training.steps": [3]}}, ".vary.training.steps", "cannot be drawn"),
        (
            {"vary": {"charging.power_w": {"from": 0, "to": 3, "scale": "log"}}},
            ".vary.charging.power_w.from",
            "above 0",
        ),
        (
            {"vary": {"nodes.weights": {"each": {"from": -1, "to": 3}}}},
            ".vary.nodes.weights.each.from",
            "greater than or equal to 0",
        ),
        ({"weigt": 2}, ".weigt", "did you mean 'weight'?"),
        ({"weight": 0}, ".weight", "greater than 0"),
        ({"scenario": "paper/k99"}, "", "no scenario 'paper/k99'"),
        ("paper/k99", "", "no scenario 'paper/k99'"),
    ],
)
def test_mistakes_are_reported_with_their_line(tmp_path, entry, where, message):
    file = tmp_path / "mine.yaml"
    text = yaml.dump({"extends": "random/k5-fdd", **TABLE, "training": {"over": [entry]}})
    file.write_text(text)
    with pytest.raises(InputError) as error:
        load_scenario(file)
    assert f"training.over[0]{where}" in str(error.value)
    assert message in str(error.value)
    assert str(error.value).startswith(f"{file}:")
    assert "\n" not in str(error.value)


def test_names_are_of_one_family_each():
    with pytest.raises(InputError, match=r"over\[1\].name: 'random/k5-fdd' is that of over\[0\]"):
        over("random/k5-fdd", "random/k5-fdd")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"observation": {"kind": "paper"}}, "must be table for training.over"),
        ({"nodes.redraw": "run"}, "must be episode for training.over"),
        ({"training.discount": 1.0}, "must be below 1 for training.over"),
    ],
)
def test_what_it_does_not_go_with_is_refused(changes, message):
    with pytest.raises(InputError, match=message):
        over({"vary": VARY}, **changes)


def test_files_of_data_that_only_draws_read_are_refused(tmp_path):
    series = tmp_path / "wind.csv"
    series.write_text("time_s,wind_m_per_s\n0,5\n100000,6\n")
    wind = {"kind": "series", "file": str(series)}
    vary = {"vary": {"channel": [{"kind": "sonar", "wind": wind}]}}
    with pytest.raises(InputError, match=r"vary.channel\[0\]: .*wind.csv: of files of data only"):
        over(vary)
