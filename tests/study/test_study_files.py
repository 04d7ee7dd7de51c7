"""What a study's file may say, and how a mistake in it is told."""

import json
from pathlib import Path

import pytest
from tiny_study import STUDY, write_study

from iout_marl import InputError, load_scenario
from iout_marl.study import expand, load_study
from iout_marl.world import pin_layout


def cells_of(path, overrides=(), *, quick=False):
    return expand(*load_study(path), overrides, quick=quick)


def changed(group, **changes):
    return {"groups": {**STUDY["groups"], group: {**STUDY["groups"][group], **changes}}}


def test_cells_are_the_product_of_scenarios_variants_grid_policies_and_seeds(tmp_path):
    cells = cells_of(write_study(tmp_path / "study.yaml"))
    places = [(c.group, c.series, c.axis, c.seed, c.episodes) for c in cells]
    assert places == [
        ("baseline", "greedy", 1, 7, 3),
        ("baseline", "greedy", 2, 7, 3),
        ("trained", "ppo, paper", 2, 0, 1),
        ("trained", "ppo, paper", 2, 1, 1),
        ("trained", "ppo, no age", 2, 0, 1),
        ("trained", "ppo, no age", 2, 1, 1),
    ]
    assert [c.scenario.reward.age_weight for c in cells if c.trains] == [1, 1, 0, 0]
    assert len({c.key for c in cells}) == len(cells)


def test_quick_keeps_its_values_of_the_axis_and_its_number_of_seeds(tmp_path):
    cells = cells_of(write_study(tmp_path / "study.yaml"), quick=True)
    assert [(c.series, c.axis, c.seed) for c in cells] == [
        ("greedy", 2, 7),
        ("ppo, paper", 2, 0),
        ("ppo, no age", 2, 0),
    ]


def test_quick_leaves_out_the_groups_it_names(tmp_path):
    path = write_study(tmp_path / "study.yaml", quick={"without": ["trained"]})
    assert {c.group for c in cells_of(path)} == {"baseline", "trained"}
    assert {c.group for c in cells_of(path, quick=True)} == {"baseline"}


def test_quick_settings_lie_over_those_of_the_groups_and_overrides_over_all(tmp_path):
    quick = {"settings": {"training.steps": 240}}
    path = write_study(tmp_path / "study.yaml", quick=quick)
    assert {c.scenario.training.steps for c in cells_of(path)} == {560}
    assert {c.scenario.training.steps for c in cells_of(path, quick=True)} == {240}
    over = cells_of(path, ["training.steps=320"], quick=True)
    assert {c.scenario.training.steps for c in over} == {320}


def test_the_axis_may_be_any_number_of_the_scenario(tmp_path):
    axis = {"key": "reward.age_weight", "label": "w"}
    cells = cells_of(
        write_study(tmp_path / "study.yaml", axis=axis, groups={"t": STUDY["groups"]["trained"]})
    )
    assert [c.axis for c in cells] == [1, 1, 0, 0]


def test_a_cell_keeps_its_key_when_the_study_around_it_changes(tmp_path):
    before = {c.key for c in cells_of(write_study(tmp_path / "a.yaml"))}
    more = changed("trained", seeds=[0, 1, 2])
    after = {c.key for c in cells_of(write_study(tmp_path / "b.yaml", title="Another", **more))}
    assert before < after
    episodes = changed("baseline", episodes=4)
    assert before - {c.key for c in cells_of(write_study(tmp_path / "c.yaml", **episodes))}


def test_one_bound_is_enough_where_nodes_stay_and_each_layout_has_its_own(tmp_path):
    group = {"scenarios": ["best/k3-fdd"], "policies": ["greedy", "bound"], "seeds": [4, 5]}
    for scenario, seeds in (("best/k3-fdd", [4]), ("random/k3-fdd", [4, 5])):
        groups = {"g": group | {"scenarios": [scenario]}}
        cells = cells_of(write_study(tmp_path / "s.yaml", groups=groups, quick={}))
        assert [c.seed for c in cells if c.policy == "bound"] == seeds
        assert [c.seed for c in cells if c.policy == "greedy"] == [4, 5]


def test_quick_searches_as_long_as_it_says(tmp_path):
    group = {"scenarios": ["best/k3-fdd"], "policies": ["planner", "bound"], "bound_seconds": 9}
    for quick, efforts in (({}, (None, 9)), ({"planner_rounds": 0, "bound_seconds": 2}, (0, 2))):
        path = write_study(tmp_path / "s.yaml", groups={"g": group}, quick=quick)
        planner, bound = cells_of(path, quick=True)
        assert (planner.planner_rounds, bound.bound_seconds) == efforts


@pytest.mark.slow
@pytest.mark.parametrize("study", ["paper", "gap"])
@pytest.mark.parametrize("quick", [False, True])
def test_every_world_of_these_studies_has_a_bound(study, quick):
    cells = cells_of(study, quick=quick)
    worlds = {pin_layout(c.scenario, c.seed).world_hash for c in cells}
    bounded = {pin_layout(c.scenario, c.seed).world_hash for c in cells if c.policy == "bound"}
    assert worlds == bounded


def test_the_paper_study_has_every_cell_of_the_paper():
    cells = cells_of("paper")
    assert {c.axis for c in cells} == {3, 5, 7, 10}
    for series, seeds in (("PPO-TDD", 3), ("PPO-FDD", 3), ("greedy", 1), ("random-walk", 1)):
        assert sum(c.series == series for c in cells) == 4 * seeds
    episodes = {c.episodes for c in cells if c.policy == "round-robin"}
    assert episodes == {100}
    terms = {c.series for c in cells if c.group.startswith("terms")}
    assert len(terms) == 8


def test_the_paper_study_without_a_term_differs_from_it_in_that_term_alone():
    cells = cells_of("paper")
    for mode in ("tdd", "fdd"):
        whole = next(c for c in cells if c.group == mode and c.axis == 10).scenario
        for cell in cells:
            if cell.group == f"terms-{mode}":
                changed = {
                    key
                    for key, value in cell.scenario.reward.model_dump().items()
                    if value != getattr(whole.reward, key)
                }
                assert changed
                assert all(getattr(cell.scenario.reward, key) == 0 for key in changed)
                assert cell.scenario.world_hash == whole.world_hash


def test_the_quick_paper_study_is_one_seed_of_3_and_10_nodes():
    cells = cells_of("paper", quick=True)
    assert {c.axis for c in cells} == {3, 10}
    assert {c.seed for c in cells} == {0}


MISTAKES = {
    "unknown policy": (
        changed("trained", policies=["pppo"]),
        r"groups\.trained\.policies\[0\]: unknown policy 'pppo'; did you mean 'ppo'\?",
    ),
    "empty grid": (
        changed("baseline", grid={"nodes.count": []}),
        r"groups\.baseline\.grid\.nodes\.count: is empty",
    ),
    "rounds without a planner": (
        changed("baseline", planner_rounds=3),
        r"groups\.baseline\.planner_rounds: there is no 'planner' among the group's policies",
    ),
    "seconds without a bound": (
        changed("trained", bound_seconds=3),
        r"groups\.trained\.bound_seconds: there is no 'bound' among the group's policies",
    ),
    "a series of bounds and policies": (
        changed("baseline", policies=["greedy", "bound"], series="{nodes.count}"),
        r"groups\.baseline: the series '1' has bounds and policies; tell them apart",
    ),
    "no groups": ({"groups": {}}, r"groups: .*at least 1"),
    "no scenarios": (changed("baseline", scenarios=[]), r"scenarios: must list at least 1"),
    "no policies": (changed("baseline", policies=[]), r"policies: must list at least 1"),
    "no seeds": (changed("baseline", seeds=[]), r"seeds: must list at least 1"),
    "no variants": (changed("baseline", variants={}), r"variants: .*at least 1"),
    "twice the same seed": (changed("trained", seeds=[1, 1]), "seeds: lists the same value twice"),
    "negative seed": (changed("trained", seeds=[-1]), r"seeds\[0\]: .*greater than or equal to 0"),
    "no episodes": (changed("trained", episodes=0), "episodes: .*greater than or equal to 1"),
    "unknown scenario": (
        changed("trained", scenarios=["paper/k3-fdf"]),
        r"groups\.trained: no scenario 'paper/k3-fdf'.*did you mean 'paper/k3-fdd' or ",
    ),
    "unknown setting": (
        changed("trained", settings={"reward.age_wieght": 0}),
        r"groups\.trained: .*reward\.age_wieght: unknown key; did you mean 'age_weight'\?",
    ),
    "unknown group": (
        {"quick": {"without": ["trianed"]}},
        r"quick\.without\[0\]: unknown group 'trianed'; did you mean 'trained'",
    ),
    "unknown key": ({"gruops": {}}, "gruops: unknown key; did you mean 'groups'"),
    "unknown report": (
        {"report": "papers"},
        "report: unknown report .papers.; did you mean .paper.",
    ),
    "axis of words": (
        {"axis": {"key": "reward.kind"}},
        r"axis\.key: 'reward\.kind' is no number in paper/k3-fdd, but 'paper'",
    ),
    "axis of nothing": ({"axis": {"key": "reward.weight"}}, r"axis\.key: .*but None"),
    "unknown field of a series": (
        changed("trained", series="{polciy}"),
        r"groups\.trained\.series: unknown \{polciy\} \(known: \{policy\}, \{variant\}\)",
    ),
    "empty series": (
        changed("trained", series="{variant}", variants={"": {}}),
        r"groups\.trained\.series: must not be empty",
    ),
    "far too many cells": (
        changed("baseline", grid={f"reward.{c}": list(range(100)) for c in "abcde"}),
        r"groups\.baseline: .* more than 10,000 cells, the most that a study may have",
    ),
    "far too many combinations": (
        changed("baseline", grid={f"reward.{c}": [0, 1] for c in range(5_000)}),
        "more than 10,000 cells",
    ),
    "a few cells too many": (
        changed("trained", seeds=list(range(2_000)), grid={"age.maximum": [1, 2, 3]}),
        r"groups\.trained: .* more than 10,000 cells",
    ),
    "episodes without end": (
        changed("trained", episodes=10**19),
        "episodes: .*less than or equal to 100000",
    ),
    "a search without end": (
        changed("baseline", policies=["bound"], bound_seconds=1e300),
        "bound_seconds: .*less than or equal to",
    ),
    "a title with an escape": ({"title": "a\x1bb"}, "title: must not hold the control character"),
    "a title of two lines": ({"title": "a\nb"}, "title: must not hold the control character"),
    "an endless title": ({"title": "a" * 5_000}, "title: must have at most 1,000 characters"),
    "an odd label": ({"axis": {"label": "\u2028"}}, r"axis\.label: must not hold"),
    "an odd group": ({"groups": {"a\x07": STUDY["groups"]["baseline"]}}, "control character"),
    "an odd variant": (changed("trained", variants={"a\x07": {}}), "control character"),
    "an odd value in a series": (
        changed("trained", series="{grid.cells}", grid={"grid.cells": ["a\x07"]}),
        r"groups\.trained: ",
    ),
    "place beyond all": (
        {**changed("trained", settings={"age.maximum": 1e300}), "axis": {"key": "age.maximum"}},
        r"age\.maximum",
    ),
    "two cells in one place": (
        changed("trained", series="ppo"),
        r"groups\.trained: two cells of the series 'ppo' share the place 2",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize(("changes", "message"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_is_told_with_file_and_line(tmp_path, changes, message):
    path = write_study(tmp_path / "study.yaml", **changes)
    with pytest.raises(InputError, match=message) as error:
        cells_of(path)
    assert str(error.value).partition(": ")[0].split(":")[0].endswith("study.yaml")
    assert "\n" not in str(error.value)


STUDIES = ["bay", "fairness", "gap", "multi", "paper", "sea", "sea-deployments", "sea-life"]


@pytest.mark.slow
@pytest.mark.parametrize("text", ["extends: paper/k3-fdd", "grid: {}", "matrix: {axes: {}}"])
def test_a_scenario_is_no_study(tmp_path, text):
    path = tmp_path / "mine.yaml"
    path.write_text(f"description: x\n{text}\n")
    with pytest.raises(InputError, match=r"^\S*mine\.yaml: is a scenario, not a study$"):
        load_study(path)


@pytest.mark.slow
@pytest.mark.parametrize("study", STUDIES)
def test_no_two_cells_of_a_study_are_described_alike(study):
    told = [cell.describe() for cell in cells_of(study)]
    assert len(set(told)) == len(told)


def test_a_cell_is_described_by_what_tells_it_from_others(tmp_path):
    grid = {"nodes.count": [1, 2], "reward.age_weight": [0, 0.5]}
    group = {**STUDY["groups"]["trained"], "series": "{reward.age_weight}", "grid": grid}
    group |= {"variants": {"short": {}}, "seeds": [3]}
    told = [c.describe() for c in cells_of(write_study(tmp_path / "s.yaml", groups={"g": group}))]
    assert told[:2] == [
        "0, ppo, short, paper/k3-fdd, nodes.count=1, reward.age_weight=0, seed 3",
        "0.5, ppo, short, paper/k3-fdd, nodes.count=1, reward.age_weight=0.5, seed 3",
    ]
    assert len(set(told)) == 4
    told = [cell.describe() for cell in cells_of(write_study(tmp_path / "t.yaml"))]
    assert told[1] == "greedy, paper/k3-fdd, nodes.count=2, seed 7"
    assert told[-1] == "ppo, no age, paper/k3-fdd, nodes.count=2, seed 1"


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    """A folder for a study; another one, in which one stands."""
    (tmp_path / "own").mkdir()
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path / "own"


def scenario_of(path, name, **changes):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"extends": "paper/k3-fdd", "name": name, **changes}))


def test_scenarios_are_looked_for_beside_the_study_then_among_the_bundled(elsewhere):
    scenario_of(elsewhere / "mine.yaml", "beside")
    scenario_of(elsewhere / "paper" / "k3-fdd.yaml", "own k3")
    scenario_of(Path("mine.yaml"), "here")
    scenario_of(Path("paper/k5-fdd.yaml"), "here")
    group = {"scenarios": ["mine", "mine.yaml", "paper/k3-fdd", "paper/k5-fdd"]}
    group |= {"policies": ["greedy"]}
    for scenario, name in zip(
        group["scenarios"], ("beside", "beside", "own k3", "paper/k5-fdd"), strict=True
    ):
        groups = {"g": group | {"scenarios": [scenario]}}
        (cell,) = cells_of(write_study(elsewhere / "s.yaml", groups=groups, quick={}))
        assert cell.scenario.name == name


def test_a_scenario_of_the_working_folder_alone_is_no_scenario_of_the_study(elsewhere):
    scenario_of(Path("mine.yaml"), "here")
    for name in ("mine", "mine.yaml"):
        path = write_study(elsewhere / "s.yaml", **changed("trained", scenarios=[name]))
        with pytest.raises(InputError, match=f"no scenario '{name}'.*own folder it is ") as error:
            cells_of(path)
        assert str(error.value).endswith("'../here/mine.yaml'")


def test_members_of_families_are_looked_for_as_scenarios_are(elsewhere):
    family = {"extends": "paper/k5-fdd", "matrix": {"axes": {"nodes.count": [2, 4]}}}
    for path in (elsewhere / "mine.yaml", Path("own.yaml")):
        path.write_text(json.dumps(family))
    scenarios = ["mine/2", "mine.yaml/4", "paper/k5-fdd"]
    groups = {"g": {"scenarios": scenarios, "policies": ["greedy"]}}
    cells = cells_of(write_study(elsewhere / "s.yaml", groups=groups, quick={}))
    found = [(cell.scenario.name, cell.axis) for cell in cells]
    assert found == [("mine/2", 2), ("mine/4", 4), ("paper/k5-fdd", 5)]
    for name, expected in (
        ("mine", r"s\.yaml:\d+: groups\.g: .*mine\.yaml: is a family, name one of its scenar"),
        ("mine/3", r"s\.yaml:\d+: groups\.g: no scenario 'mine/3': .*: no member '3' \(known: 2"),
        ("own/2", r"own folder it is '\.\./here/own\.yaml/2'$"),
    ):
        groups["g"]["scenarios"] = [name]
        with pytest.raises(InputError, match=expected):
            cells_of(write_study(elsewhere / "s.yaml", groups=groups, quick={}))


def test_a_training_preset_is_looked_for_beside_who_names_it(elsewhere):
    preset = {**load_scenario("paper/k3-fdd").training.model_dump(mode="json"), "steps": 111_000}
    del preset["preset"]
    for path, steps in ((elsewhere / "p.yaml", 222_000), (Path("p.yaml"), 333_000)):
        path.write_text(json.dumps({**preset, "steps": steps}))
    (elsewhere / "deep").mkdir()
    (elsewhere / "deep" / "p.yaml").write_text(json.dumps(preset))
    scenario_of(elsewhere / "deep" / "mine.yaml", "mine", training={"preset": "p.yaml"})

    def steps_of(overrides=(), **settings):
        group = {"scenarios": ["deep/mine"], "policies": ["ppo"], "settings": settings}
        path = write_study(elsewhere / "s.yaml", groups={"g": group}, quick={})
        (cell,) = cells_of(path, overrides)
        assert cell.scenario.training.preset == "p.yaml"
        return cell.scenario.training.steps

    assert steps_of() == 111_000
    assert steps_of(**{"training.preset": "p.yaml"}) == 222_000
    assert steps_of(training={"preset": "p.yaml"}) == 222_000


@pytest.mark.parametrize("own", [{"settings": {"nodes.count": 2}}, {"grid": {"nodes.count": [2]}}])
def test_a_list_over_the_studys_own_count_is_meant_as_listed(tmp_path, own):
    group = {"scenarios": ["paper/k5-fdd"], "policies": ["greedy"], **own}
    path = write_study(tmp_path / "study.yaml", groups={"g": group}, quick={})
    assert [cell.scenario.num_nodes for cell in cells_of(path)] == [2]
    over = cells_of(path, ["nodes.cells=[[1, 1, 1], [2, 2, 1], [3, 3, 1]]"])
    assert [cell.scenario.num_nodes for cell in over] == [3]


def test_quick_that_leaves_nothing_is_refused(tmp_path):
    path = write_study(tmp_path / "study.yaml", quick={"axis": [99]})
    with pytest.raises(InputError, match="no cell left by --quick"):
        cells_of(path, quick=True)


def test_a_study_that_is_not_there_is_told_with_what_is():
    with pytest.raises(InputError, match="no study 'papr'; did you mean 'paper'"):
        load_study("papr")


def test_a_scenario_s_name_that_no_file_can_have_is_refused(tmp_path):
    path = write_study(tmp_path / "study.yaml")
    path.write_text(path.read_text().replace("paper/k3-fdd", "A" * 400))
    with pytest.raises(InputError, match="no scenario 'AAAA"):
        expand(*load_study(path))
