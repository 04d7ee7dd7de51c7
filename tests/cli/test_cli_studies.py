"""`iout reproduce` and `iout report`, as typed."""

import json
import os
import shutil
import signal
import sys
import tempfile
from pathlib import Path

import forked
import pytest
from tiny_study import STUDY, write_study

from iout_marl import InputError

pytestmark = pytest.mark.slow


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
    assert "failed: ppo, wild, nodes.count 2, seed 0: training diverged" in err
    assert tempfile.gettempdir() not in err.replace(str(tmp_path), "")
    assert "checkpoint" not in err
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


def test_folder_that_cannot_be_written_is_refused(refused, finished, tmp_path):
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


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("report", "nowhere"), "nowhere: no such folder"),
        (("report", "a file"), "a file: is a file, not a folder"),
        (("report", "empty"), "empty: holds no results.json; iout reproduce --out DIR makes one"),
        (("report", "begun"), "begun: holds no results.json: its study is not finished; iout rep"),
        (("report", "above"), "above: holds no results.json; did you mean above/out?"),
        (
            ("report", "out", "--markdown", "empty"),
            "empty: cannot be written: is a folder, not a file",
        ),
        (("report", "out", "--markdown", "no/a.md"), "no/a.md: cannot be written: "),
        (("report", "damaged"), "damaged/results.json: cannot be read: damaged, it is no JSON"),
        (("report", "deep"), "deep/results.json: cannot be read: damaged, it is no JSON (nested"),
        (("report", "folder"), "folder/results.json: cannot be read: Is a directory"),
        (("report", "closed"), "closed/figures: cannot be made: "),
        (("reproduce", "--jobs", "900"), "--jobs 900: must be at most "),
        (("reproduce", "--scheduler", ""), "--scheduler : must be an address such as tcp://"),
        (("reproduce", "--study", ""), "no study ''"),
        (("reproduce", "--study", "out"), "no study 'out'"),
        (("reproduce", "--study", "papr"), "no study 'papr'; did you mean 'paper'?"),
    ],
)
def test_what_cannot_be_meant_is_told_in_one_line(refused, folder, tmp_path, words, message):
    (tmp_path / "a file").write_text("")
    for name in ("empty", "begun", "damaged", "deep", "folder", "closed", "above"):
        (tmp_path / name).mkdir()
    shutil.copytree(folder, tmp_path / "above" / "out")
    shutil.copy(folder / "study.json", tmp_path / "begun")
    (tmp_path / "damaged" / "results.json").write_text("{")
    (tmp_path / "deep" / "results.json").write_text("[" * 100_000)
    (tmp_path / "folder" / "results.json").mkdir()
    shutil.copy(folder / "results.json", tmp_path / "closed")
    (tmp_path / "closed" / "figures").write_text("in the way")
    before = {path for path in tmp_path.rglob("*") if path.parent.name != "figures"}
    assert message in refused(*words)
    after = {path for path in tmp_path.rglob("*") if path.parent.name != "figures"}
    assert after - {tmp_path / "out" / "report.html"} <= before


def test_a_report_that_cannot_be_written_costs_no_result(iout, finished, folder):
    shutil.rmtree(folder / "figures")
    (folder / "figures").write_text("in the way")
    (folder / "results.json").unlink()
    words = ("--study", finished / "tiny.yaml", "--out", folder, "--jobs", "1")
    status, _, err = iout("reproduce", *words)
    assert status == 2
    assert "figures: cannot be made: File exists; the results are kept, write their report" in err
    assert f"with: iout report {folder}" in err
    assert len(json.loads((folder / "results.json").read_text())["cells"]) == 6


def test_streams_that_nobody_reads_cost_no_result(tmp_path):
    study = write_study(tmp_path / "s.yaml", groups={"baseline": STUDY["groups"]["baseline"]})
    read, write = os.pipe()
    os.close(read)
    words = ["reproduce", "--study", str(study), "--out", "out", "--jobs", "1"]
    done = forked.run(*words, streams=(forked.PIPE, write, write))
    assert done.returncode == 141
    os.close(write)
    assert len(json.loads(Path("out/results.json").read_text())["cells"]) == 2
    assert Path("out/report.html").exists()


def test_streams_that_are_closed_cost_no_result(iout, finished, folder, monkeypatch):
    (folder / "results.json").unlink()
    monkeypatch.setattr(sys, "stdout", None)
    monkeypatch.setattr(sys, "stderr", None)
    iout("reproduce", "--study", finished / "tiny.yaml", "--out", folder, "--jobs", "1")
    assert len(json.loads((folder / "results.json").read_text())["cells"]) == 6


@pytest.mark.parametrize(
    "name", [pytest.param("SIGHUP", marks=pytest.mark.posix), "SIGINT", "SIGTERM"]
)
def test_a_signal_that_comes_as_the_report_is_written_loses_nothing(
    iout, finished, folder, monkeypatch, name
):
    def interrupted(results):
        signal.raise_signal(getattr(signal, name))

    monkeypatch.setattr("iout_marl.report.build.build_report", interrupted)
    before = [signal.getsignal(getattr(signal, name))]
    words = ("--study", finished / "tiny.yaml", "--out", folder, "--jobs", "1")
    (folder / "results.json").unlink()
    status, _, err = iout("reproduce", *words)
    assert status == 128 + getattr(signal, name)
    assert (
        f"stopped; what is finished stays. Continue with: iout reproduce --study {finished}" in err
    )
    assert (folder / "results.json").exists()
    assert [signal.getsignal(getattr(signal, name))] == before


@pytest.mark.posix
def test_a_hangup_that_is_ignored_stays_so(iout, finished, folder, monkeypatch):
    def hung_up(results):
        signal.raise_signal(signal.SIGHUP)
        raise InputError("reached")

    monkeypatch.setattr("iout_marl.report.build.build_report", hung_up)
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        words = ("--study", finished / "tiny.yaml", "--out", folder, "--jobs", "1")
        status, _, err = iout("reproduce", *words)
    finally:
        signal.signal(signal.SIGHUP, before)
    assert status == 2
    assert "reached" in err


def test_setting_that_fits_no_scenario_is_refused(refused, finished):
    line = refused(
        "reproduce", "--study", finished / "tiny.yaml", "--out", "out", "--set", "grid.cels=[1,1,1]"
    )
    assert "did you mean 'cells'?" in line


def test_jobs_and_a_cluster_exclude_one_another(refused):
    assert "--jobs and --scheduler" in refused("reproduce", "--jobs", "2", "--scheduler", "a:1")
