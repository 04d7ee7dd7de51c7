"""Running a study: what is kept, what is run again, what fails alone."""

import json
import shutil
from functools import partial

import pytest
from rich.console import Console
from tiny_study import SETTINGS, DeadlyProcesses, SameProcess, write_study

from iout_marl import InputError, evaluate
from iout_marl.bounds import Certificate, verified_age_sum
from iout_marl.study import Results, expand, load_study, run_study
from iout_marl.study.pools import LocalProcesses
from iout_marl.study.results import Measured, read_results
from iout_marl.study.run import StudyFolder
from iout_marl.trajectory import Trajectory
from iout_marl.world import pin_layout
from trainers import RunFolder

QUIET = Console(quiet=True)
IDENTITY = {"name": "tiny", "title": "A tiny study", "overrides": [], "quick": False}


def opened(path, **changes):
    with StudyFolder(path).open({**IDENTITY, **changes}):
        pass


@pytest.fixture
def study(tmp_path):
    return load_study(write_study(tmp_path / "tiny.yaml"))


def run_in(path, study, pool=None, cells=None):
    """Runs the tiny study in a folder."""
    folder = StudyFolder(path)
    with folder.open(IDENTITY):
        return run_study(
            "tiny",
            study[0],
            expand(*study) if cells is None else cells,
            folder,
            pool or SameProcess(),
            "iout reproduce",
            console=QUIET,
        )


@pytest.fixture
def run(study, tmp_path):
    """Runs the tiny study in tmp_path/out."""
    return partial(run_in, tmp_path / "out", study)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A folder in which the tiny study has been run, once for all that is asked of it."""
    folder = tmp_path_factory.mktemp("finished")
    run_in(folder / "out", load_study(write_study(folder / "tiny.yaml")))
    return folder / "out"


@pytest.fixture
def results(finished, tmp_path):
    """The results of the tiny study, which has been run in tmp_path/out."""
    shutil.copytree(finished, tmp_path / "out")
    return read_results(tmp_path / "out" / "results.json")


@pytest.mark.slow
def test_every_cell_gives_its_record_and_the_folder_holds_all_of_it(run, study, tmp_path):
    results = run()
    cells = expand(*study)
    assert [c.record.key for c in results.cells] == [c.key for c in cells]
    assert results == read_results(tmp_path / "out" / "results.json")
    rows = (tmp_path / "out" / "results.csv").read_text().splitlines()
    assert len(rows) == 1 + len(cells)
    assert len({len(row.split(",")) for row in rows if '"' not in row}) == 1


@pytest.mark.slow
def test_a_baseline_cell_says_what_evaluate_says(results, study):
    cell = expand(*study)[0]
    expected = evaluate(cell.scenario, "greedy", episodes=3, seed=7)
    record = results.cells[0].record
    assert record.samples["mean_aoi"] == pytest.approx(expected.samples["mean_aoi"], rel=1e-6)
    assert record.training is None
    assert record.scenario_hash == expected.scenario_hash


@pytest.mark.slow
def test_a_trained_cell_keeps_its_run_its_curve_and_an_episode(results, study, tmp_path):
    cell = next(c for c in expand(*study) if c.trains)
    record = next(c.record for c in results.cells if c.record.key == cell.key)
    policy = RunFolder(tmp_path / "out" / "runs" / cell.key).load_policy()
    again = evaluate(cell.scenario, policy, episodes=1)
    assert record.samples["mean_aoi"] == pytest.approx(again.samples["mean_aoi"], rel=1e-6)
    assert record.training.env_steps == 560
    assert record.training.seconds > 0
    assert record.training.emissions.energy_kwh > 0
    assert record.training.curve["env_steps"][-1] == 560
    assert len({len(values) for values in record.training.curve.values()}) == 1
    episode = Trajectory(**record.episode)
    assert len(episode.delivered) == 20
    ages = [sum(slot) / len(slot) for slot in episode.ages]
    assert sum(ages) / 20 == pytest.approx(record.mean("mean_aoi"), rel=1e-6)


@pytest.fixture
def searched(tmp_path):
    """A study of bounds beside what they bound, in two layouts."""
    settings = {**SETTINGS, "nodes": {"kind": "random", "count": 2, "redraw": "run"}}
    del settings["nodes.cells"]
    group = {
        "scenarios": ["paper/k3-fdd"],
        "policies": ["greedy", "planner", "bound"],
        "seeds": [0, 1],
        "episodes": 2,
        "planner_rounds": 1,
        "bound_seconds": 1,
        "settings": settings,
    }
    quick = {"planner_rounds": 0, "bound_seconds": 0.5}
    return load_study(write_study(tmp_path / "s.yaml", groups={"searched": group}, quick=quick))


@pytest.mark.slow
def test_bounds_stand_beside_what_they_bound(run, searched, tmp_path):
    cells = expand(*searched)
    results = run(cells=cells)
    read_results(tmp_path / "out" / "results.json")
    records = {(c.record.policy, c.record.seed): c.record for c in results.cells}
    for seed in (0, 1):
        bound, planner, greedy = (records[name, seed] for name in ("bound", "planner", "greedy"))
        assert bound.world_hash == planner.world_hash == greedy.world_hash
        assert set(bound.samples) == {"mean_aoi"}
        assert bound.mean("mean_aoi") <= planner.mean("mean_aoi") <= greedy.mean("mean_aoi")
        layout = pin_layout(cells[0].scenario, seed)
        saved = json.loads((tmp_path / "out" / "runs" / bound.key / "bound.json").read_text())
        assert saved["best"] == pytest.approx(bound.mean("mean_aoi"), rel=1e-6)
        certificate = Certificate.from_json(saved["certificate"])
        assert verified_age_sum(layout, certificate) == pytest.approx(saved["best"] * 2 * 20)
        assert bound.search == f"{saved['certificate']['kind']}, 1 s"
        assert planner.search == "1 rounds"
    assert records["bound", 0].world_hash != records["bound", 1].world_hash
    assert results.measured("bound", 2, "jain") is None
    assert ",bound,0,1," in results.to_csv()


def test_how_long_a_search_takes_is_part_of_its_cell_alone(searched):
    usual, quick = expand(*searched), expand(*searched, quick=True)
    efforts = [[(c.planner_rounds, c.bound_seconds) for c in s[::2]] for s in (usual, quick)]
    assert efforts[0] == [(None, None), (1, None), (None, 1)]
    assert efforts[1] == [(None, None), (0, None), (None, 0.5)]
    assert [a.key == b.key for a, b in zip(usual, quick, strict=True)] == [True, True, *[False] * 4]


@pytest.mark.slow
def test_a_stopped_study_goes_on_from_its_last_finished_cell(run):
    stopped = SameProcess(stop_after=3)
    with pytest.raises(KeyboardInterrupt):
        run(stopped)
    rest = SameProcess()
    results = run(rest)
    assert len(results.cells) == 6
    assert len(rest.ran) == 3
    assert not set(rest.ran) & set(stopped.ran)
    assert run(SameProcess(stop_after=0)) == results


@pytest.mark.slow
def test_cells_that_compute_the_same_are_run_once(run, study):
    cells = expand(*study)
    twin = [*cells, *(type(c)("twin", "twin", *list(vars(c).values())[2:]) for c in cells[:2])]
    pool = SameProcess()
    results = run(pool, twin)
    assert len(pool.ran) == 6
    assert len(results.cells) == 8


@pytest.mark.slow
def test_a_failed_cell_is_reported_and_tried_again_and_stops_nothing(run, study):
    broken = expand(*study)[2]
    results = run(SameProcess({broken.key: ValueError("broken\nfor good")}))
    assert len(results.cells) == 5
    (failure,) = results.failures
    assert (failure.series, failure.axis, failure.seed) == ("ppo, paper", 2, 0)
    assert failure.error == "ValueError: broken"
    again = SameProcess()
    assert run(again).failures == ()
    assert again.ran == [broken.key]


@pytest.mark.slow
def test_the_longest_cells_come_first(run):
    pool = SameProcess()
    run(pool)
    assert ["-ppo-" in key for key in pool.ran] == [True] * 4 + [False] * 2


@pytest.mark.slow
def test_processes_give_what_one_process_gives(run, results, tmp_path):
    (tmp_path / "out").rename(tmp_path / "first")
    there = run(LocalProcesses(2))
    for a, b in zip(results.cells, there.cells, strict=True):
        assert a.record.samples == b.record.samples
        assert a.record.episode == b.record.episode


@pytest.mark.slow
def test_a_cell_that_kills_its_process_fails_alone(run):
    results = run(DeadlyProcesses(2))
    assert {(f.series, f.seed) for f in results.failures} == {("ppo, paper", 1), ("ppo, no age", 1)}
    assert all("its process died" in f.error for f in results.failures)
    assert len(results.cells) == 4


def test_a_folder_of_something_else_is_left_as_it_is(tmp_path):
    (tmp_path / "thesis.tex").write_text("all of it")
    with pytest.raises(InputError, match=r"holds no study, but thesis\.tex"):
        opened(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize(
    ("key", "value"),
    [("name", "paper"), ("title", "Another"), ("overrides", ["a.b=1"]), ("quick", True)],
)
def test_a_folder_of_another_study_is_refused(run, tmp_path, key, value):
    run(cells=[])
    before = (tmp_path / "out" / "study.json").read_bytes()
    with pytest.raises(InputError, match=f"holds a study of another {key}: .*, not "):
        opened(tmp_path / "out", **{key: value})
    assert (tmp_path / "out" / "study.json").read_bytes() == before


def test_a_folder_in_which_a_study_runs_is_refused(run, tmp_path):
    run(cells=[])
    running = StudyFolder(tmp_path / "out").open(IDENTITY)
    with running, pytest.raises(InputError, match="another study is running in it"):
        opened(tmp_path / "out")
    opened(tmp_path / "out")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["study.json", "results.json"])
@pytest.mark.usefixtures("results")
def test_what_another_version_has_written_is_not_touched(run, tmp_path, name):
    path = tmp_path / "out" / name
    path.write_text(json.dumps({**json.loads(path.read_text()), "world_version": -1}))
    before = {p: p.read_bytes() for p in (tmp_path / "out").rglob("*") if p.is_file()}
    with pytest.raises(InputError, match=rf"{name}: is of another version of this software"):
        run()
    assert before == {p: p.read_bytes() for p in (tmp_path / "out").rglob("*") if p.is_file()}


@pytest.mark.slow
@pytest.mark.usefixtures("results")
def test_a_cell_of_another_version_is_refused(run, study, tmp_path):
    path = tmp_path / "out" / "cells" / f"{expand(*study)[0].key}.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "format": 0}))
    with pytest.raises(InputError, match="is of another version"):
        run()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "damaged, it is no JSON"),
        ('{"format": 1, "world_version": 0}', "cannot be read: name: Field required"),
    ],
)
def test_damaged_results_are_told_in_one_line(tmp_path, text, message):
    path = tmp_path / "results.json"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_results(path)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: r["samples"].pop("jain"), r"samples\.jain: must hold a number for each episode"),
        (lambda r: r["samples"].update(mean_aoi=[]), r"samples\.mean_aoi: must hold"),
        (lambda r: r["samples"].update(jain=[float("nan")] * 3), "NaN is no number of JSON"),
        (lambda r: r.update(key="another"), "it is of the cell another"),
        (lambda r: r.pop("seed"), "seed: Field required"),
    ],
)
@pytest.mark.usefixtures("results")
def test_a_damaged_cell_is_told_in_one_line(run, study, tmp_path, change, message):
    path = tmp_path / "out" / "cells" / f"{expand(*study)[0].key}.json"
    data = json.loads(path.read_text())
    change(data["record"])
    path.write_text(json.dumps(data))
    with pytest.raises(InputError, match=message) as error:
        run()
    assert "\n" not in str(error.value)


@pytest.mark.slow
def test_intervals_end_where_the_metric_does(results):
    for cell in results.cells:
        estimate = results.measured(cell.series, cell.axis, "jain").estimate
        assert 0 <= estimate.low <= estimate.mean <= estimate.high <= 1
    wide = Measured((1.0, 40.0), "seeds")
    assert wide.estimate.low == 0


@pytest.mark.slow
def test_results_come_back_as_they_were_written(results):
    assert Results.model_validate_json(results.to_json()) == results
