"""`iout reproduce` and `iout report`, as typed."""

import json
import shutil

import pytest
from tiny_study import STUDY, write_study


@pytest.fixture(autouse=True)
def _working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A folder with the tiny study, run by one process, and its file."""
    from iout_marl.cli import main

    folder = tmp_path_factory.mktemp("study")
    path = write_study(folder / "tiny.yaml")
    words = ["reproduce", "--study", str(path), "--out", str(folder / "out"), "--jobs", "1"]
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert not ended.value.code
    return folder


@pytest.fixture
def folder(finished, tmp_path):
    return shutil.copytree(finished / "out", tmp_path / "out")


def files(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_reproduce_leaves_report_results_figures_and_runs(finished):
    out = finished / "out"
    names = {path.name for path in out.iterdir()}
    assert names == {
        *(".lock", "study.json", "cells", "runs", "results.json", "results.csv"),
        *("report.html", "report.md", "figures"),
    }
    figures = {path.suffix for path in (out / "figures").iterdir()}
    assert figures == {".png", ".svg", ".csv"}
    assert "A tiny study" in (out / "report.html").read_text()
    assert "| greedy | 1 |" in (out / "report.md").read_text()
    assert len(list((out / "runs").iterdir())) == 4


def test_a_finished_study_is_only_written_once_more(iout, finished, folder):
    before = (folder / "results.json").read_bytes()
    status, out, err = iout(
        "reproduce", "--study", finished / "tiny.yaml", "--out", folder, "--jobs", "1"
    )
    assert status == 0, err
    assert "report.html" in out
    assert err == ""
    data, again = json.loads(before), json.loads((folder / "results.json").read_text())
    assert data["cells"] == again["cells"]


def test_report_writes_the_same_report_from_the_results_alone(iout, folder, tmp_path):
    (tmp_path / "bare").mkdir()
    shutil.copy(folder / "results.json", tmp_path / "bare")
    status, out, _ = iout("report", tmp_path / "bare")
    assert status == 0
    assert str(tmp_path / "bare" / "report.html") in out
    for name in ("report.html", "report.md"):
        assert (tmp_path / "bare" / name).read_bytes() == (folder / name).read_bytes()


def test_markdown_elsewhere_still_finds_the_figures(iout, folder, tmp_path):
    (tmp_path / "docs").mkdir()
    status, _, _ = iout("report", folder, "--markdown", tmp_path / "docs" / "page.md")
    assert status == 0
    assert "](../out/figures/mean_aoi.png)" in (tmp_path / "docs" / "page.md").read_text()


def test_a_failed_cell_is_named_and_the_status_is_1(iout, tmp_path):
    groups = {
        "fails": {
            **STUDY["groups"]["trained"],
            "settings": {**STUDY["groups"]["trained"]["settings"], "training.learning_rate": 1e30},
            "seeds": [0],
            "variants": {"wild": {}},
        },
        "baseline": STUDY["groups"]["baseline"],
    }
    path = write_study(tmp_path / "study.yaml", groups=groups)
    status, out, err = iout("reproduce", "--study", path, "--out", tmp_path / "out", "--jobs", "1")
    assert status == 1
    assert "failed: ppo, wild, nodes.count 2, seed 0" in err
    assert "training diverged" in err
    assert "1 of 3 cells failed" in err
    assert "report.html" in out
    assert "training diverged" in (tmp_path / "out" / "report.md").read_text()


def test_unknown_study_and_policy_are_refused(refused, tmp_path):
    assert "no study 'papper'; did you mean 'paper'?" in refused("reproduce", "--study", "papper")
    trained = {**STUDY["groups"]["trained"], "policies": ["gredy"]}
    path = write_study(tmp_path / "study.yaml", groups={"trained": trained})
    line = refused("reproduce", "--study", path, "--out", "out")
    assert "unknown policy 'gredy'; did you mean 'greedy'?" in line
    assert not (tmp_path / "out").exists()


def test_empty_grid_is_refused(refused, tmp_path):
    baseline = {**STUDY["groups"]["baseline"], "grid": {"nodes.count": []}}
    path = write_study(tmp_path / "study.yaml", groups={"baseline": baseline})
    assert "grid.nodes.count: is empty" in refused("reproduce", "--study", path, "--out", "out")


def test_folder_that_can_not_be_written_is_refused(refused, finished, tmp_path):
    (tmp_path / "file").write_text("")
    line = refused("reproduce", "--study", finished / "tiny.yaml", "--out", tmp_path / "file" / "x")
    assert "cannot be" in line
    assert "file/x" in line


def test_folder_with_something_else_is_refused(refused, finished, tmp_path):
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "thesis.tex").write_text("all of it")
    line = refused("reproduce", "--study", finished / "tiny.yaml", "--out", tmp_path / "thesis")
    assert "holds no study, but thesis.tex" in line


def test_results_of_another_version_are_refused_and_kept(refused, finished, folder):
    path = folder / "results.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "format": 99}))
    before = files(folder)
    for words in (
        ("reproduce", "--study", finished / "tiny.yaml", "--out", folder),
        ("report", folder),
    ):
        assert "is of another version of this software" in refused(*words)
    assert files(folder) == before


def test_folder_without_results_is_refused(refused, tmp_path):
    assert "holds no results.json; iout reproduce --out DIR makes one" in refused(
        "report", tmp_path
    )


def test_setting_that_fits_no_scenario_is_refused(refused, finished):
    line = refused(
        "reproduce", "--study", finished / "tiny.yaml", "--out", "out", "--set", "grid.cels=[1,1,1]"
    )
    assert "did you mean 'cells'?" in line


def test_jobs_and_a_cluster_exclude_one_another(refused):
    assert "--jobs and --scheduler" in refused("reproduce", "--jobs", "2", "--scheduler", "a:1")
