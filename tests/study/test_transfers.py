"""Studies that train in one world and play in others, side by side over their variants."""

import pytest
from rich.console import Console
from tiny_study import SETTINGS, SameProcess, write_study

from iout_marl import InputError, evaluate
from iout_marl.policies.loading import named_policy
from iout_marl.report.study_figures import metric_figure
from iout_marl.study import expand, load_study, run_study
from iout_marl.study.results import read_results
from iout_marl.study.run import StudyFolder

#: What each variant makes of the world: stronger and weaker sources.
VARIANTS = {"as it is": {}, "weak": {"charging.power_w": 20}, "weaker": {"charging.power_w": 2}}
PLAYED = {
    "series": "{policy}, {variant}",
    "scenarios": ["paper/k3-fdd"],
    "policies": ["ppo"],
    "seeds": [0, 1],
    "episodes": 1,
    "settings": {**SETTINGS, "nodes.count": 2},
}
GROUPS = {
    "elsewhere": {**PLAYED, "series": "trained once", "trained_with": {}, "variants": VARIANTS},
    "greedy": {**PLAYED, "series": "{policy}", "policies": ["greedy"], "variants": VARIANTS},
}
AXIS = {"variants": list(VARIANTS), "label": "What is changed"}
IDENTITY = {"name": "tiny", "title": "A tiny study", "overrides": [], "quick": False}


def write(path, groups=GROUPS):
    return write_study(path, axis=AXIS, quick={"axis": ["weak"], "seeds": 1}, groups=groups)


def run_in(path, study, pool=None):
    folder = StudyFolder(path)
    with folder.open(IDENTITY):
        return run_study(
            "tiny",
            study[0],
            expand(*study),
            folder,
            pool or SameProcess(),
            "iout reproduce",
            console=Console(quiet=True),
        )


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The study, and the folder in which it has been run."""
    folder = tmp_path_factory.mktemp("transfers")
    study, pool = load_study(write(folder / "tiny.yaml")), SameProcess()
    run_in(folder / "out", study, pool)
    return study, folder / "out", pool


@pytest.mark.slow
def test_each_seed_is_trained_once_and_plays_in_every_world(finished):
    (study, layer), out, pool = finished
    cells = [cell for cell in expand(study, layer) if cell.group == "elsewhere"]
    trainings = [key for key in pool.ran if (out / "runs" / key / "policy.json").exists()]
    assert len(trainings) == len(set(trainings)) == 2
    # The first variant changes nothing: it is the training itself.
    assert [cell.key for cell in cells if cell.trains] == [
        cell.key for cell in cells if cell.axis == 1
    ]
    assert {cell.training.key for cell in cells if not cell.trains} == set(trainings)
    results = read_results(out / "results.json")
    for cell in cells:
        if cell.trains:
            continue
        run = out / "runs" / cell.training.key
        own, policy = named_policy(cell.scenario, str(run), cell.seed, transfer=True)
        expected = evaluate(own, policy, episodes=1, seed=cell.seed)
        record = next(each.record for each in results.cells if each.record.key == cell.key)
        assert record.samples["mean_aoi"] == pytest.approx(expected.samples["mean_aoi"], rel=1e-6)
        assert record.scenario_hash == cell.scenario.hash
        assert record.trained_in == f"{cell.trained_in.name}, {cell.trained_in.hash}"
        assert record.training is None
        assert record.episode is not None


@pytest.mark.slow
def test_a_training_that_is_no_cell_of_its_own_is_run_and_not_shown(finished, tmp_path):
    groups = {"elsewhere": {**GROUPS["elsewhere"], "variants": {"weak": VARIANTS["weak"]}}}
    study = load_study(write(tmp_path / "tiny.yaml", groups))
    pool = SameProcess()
    results = run_in(tmp_path / "out", study, pool)
    assert len(pool.ran) == 4
    assert len(results.cells) == 2
    _, out, _ = finished
    same = {cell.record.key: cell.record.samples for cell in results.cells}
    before = {c.record.key: c.record.samples for c in read_results(out / "results.json").cells}
    assert same.items() <= before.items()
    # All is there: nothing is run again.
    again = SameProcess()
    assert run_in(tmp_path / "out", study, again).to_json() == results.to_json()
    assert again.ran == []


@pytest.mark.slow
def test_where_a_training_fails_so_do_those_that_would_play_its_run(tmp_path):
    study = load_study(write(tmp_path / "tiny.yaml"))
    cells = expand(*study)
    broken = next(cell for cell in cells if cell.trains and cell.seed == 1)
    pool = SameProcess({broken.key: InputError("no luck")})
    results = run_in(tmp_path / "out", study, pool)
    told = {(f.axis, f.seed): f.error for f in results.failures}
    assert told == {
        (1.0, 1): "no luck",
        (2.0, 1): f"its training in {broken.scenario.name} failed",
        (3.0, 1): f"its training in {broken.scenario.name} failed",
    }
    assert not run_in(tmp_path / "out", study).failures


@pytest.mark.slow
def test_variants_are_named_where_places_are(finished):
    _, out, _ = finished
    results = read_results(out / "results.json")
    assert [results.place_text(place) for place in results.places()] == list(VARIANTS)
    rows = (out / "results.csv").read_text().splitlines()
    assert rows[0].split(",")[2] == "variant"
    assert {row.split(",")[2] for row in rows[1:]} == set(VARIANTS)
    figure = metric_figure(results, "aoi", "AoI", "mean_aoi", results.series)
    assert figure.x.is_categorical
    assert {row[1] for row in list(figure.rows())[1:]} == set(VARIANTS)
    assert "trained once: 2 trainings, 1 episode each" in figure.caption


def test_quick_names_variants_of_the_axis(tmp_path):
    cells = expand(*load_study(write(tmp_path / "tiny.yaml")), quick=True)
    assert {(cell.variant, cell.axis, cell.seed) for cell in cells} == {("weak", 2.0, 0)}


def of_group(**changes):
    return {"groups": {"elsewhere": {**GROUPS["elsewhere"], **changes}}}


MISTAKES = {
    "key beside variants": (
        {"axis": {**AXIS, "key": "charging.power_w"}},
        r"axis\.variants: is given beside key",
    ),
    "twice": ({"axis": {"variants": ["weak", "weak"]}}, r"axis\.variants: lists the same value"),
    "not on the axis": (
        of_group(variants={"wek": {}}),
        r"groups\.elsewhere\.variants: 'wek' is not in axis\.variants; did you mean 'weak'",
    ),
    "not trained": (of_group(policies=["greedy"]), r"policies\[0\]: 'greedy' is not trained"),
    "unknown key": (of_group(trained_with={"charging.powr_w": 1}), r"charging\.powr_w"),
}


@pytest.mark.parametrize(("changes", "message"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_is_told_with_its_place(tmp_path, changes, message):
    path = write_study(tmp_path / "tiny.yaml", **{"axis": AXIS, "groups": GROUPS, **changes})
    with pytest.raises(InputError, match=message):
        expand(*load_study(path))
