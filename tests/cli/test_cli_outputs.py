"""No file that a command reads is written over by what it writes."""

import json
import os
import shutil

import pytest
from fake_results import record, results
from tiny_study import write_study

import trainers
from iout_marl.scenario import bundled_root

PLAY = ["--policy", "greedy", "--episodes", 1]
READ = "cannot be written: it is read by the same command"


@pytest.fixture(autouse=True)
def _working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def own(tmp_path):
    """A scenario that extends another one, and takes a preset; all three are the user's."""
    (tmp_path / "base.yaml").write_text("extends: paper/k3-fdd\n")
    shutil.copy(bundled_root() / "training" / "fast.yaml", tmp_path / "preset.yaml")
    (tmp_path / "own.yaml").write_text("extends: base.yaml\ntraining: {preset: preset.yaml}\n")
    return tmp_path / "own.yaml"


@pytest.fixture(scope="module")
def finished(tmp_path_factory, tiny):
    folder = tmp_path_factory.mktemp("finished") / "run"
    trainers.train(tiny(), folder, evaluation_episodes=1)
    return folder


def contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("target", ["own.json", "soft.json", "hard.json"])
@pytest.mark.parametrize("words", [["evaluate", *PLAY], ["bound", "--seconds", 0]], ids=str)
def test_scenario_and_what_it_is_made_of(refused, tmp_path, words, target):
    (tmp_path / "base.json").write_text('{"extends": "best/k3-fdd"}')
    own = tmp_path / "own.json"
    own.write_text('{"extends": "./base.json"}')
    (tmp_path / "soft.json").symlink_to("base.json")
    os.link(tmp_path / "base.json", tmp_path / "hard.json")
    before = contents(tmp_path)
    command, *options = words
    assert refused(command, own, *options, "--json", target) == f"{target}: {READ}"
    assert contents(tmp_path) == before


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["policy.json", "scenario.yaml", "result.json", "run.json", "metrics.jsonl", ".lock"]
)
@pytest.mark.parametrize("option", ["--policy", "--planner-start"])
def test_files_of_a_run(refused, finished, tiny_settings, option, name):
    before = contents(finished)
    words = ["evaluate", "best/k3-fdd", *tiny_settings, option, finished]
    words += ["--policy", "planner"] if option == "--planner-start" else []
    line = refused(*words, "--json", finished / name)
    if name.endswith(".json"):
        assert line.endswith(f"{name}: cannot be written: it is a file of the run {finished}")
    else:
        assert f"{name}: must end in .json" in line
    assert contents(finished) == before


def test_other_files_beside_those_of_a_run(iout, finished, tiny_settings):
    words = ["evaluate", "best/k3-fdd", *tiny_settings, "--policy", finished, "--episodes", 1]
    for _ in range(2):  # what it has written itself it may write over
        assert iout(*words, "--json", finished / "mine.json")[0] == 0
    assert json.loads((finished / "mine.json").read_text())["episodes"] == 1


@pytest.mark.parametrize(
    ("target", "line"),
    [
        ("own.yaml", "must end in .json"),
        ("soft.json", "holds something else than JSON"),
        ("half.json", "holds something else than JSON"),
    ],
)
@pytest.mark.parametrize(
    "words",
    [
        ["evaluate", "paper/k3-fdd", *PLAY, "--json"],
        ["evaluate", "paper/k3-fdd", *PLAY, "--save-episode"],
        ["bound", "paper/k3-fdd", "--seconds", 0, "--json"],
        ["schema", "--output"],
    ],
    ids=str,
)
def test_files_of_anything_but_json(refused, own, tmp_path, words, target, line):
    (tmp_path / "soft.json").symlink_to(own)
    (tmp_path / "half.json").write_text('{"episodes": ')
    before = contents(tmp_path)
    assert f": {target}: {line}" in refused(*words, target)
    assert contents(tmp_path) == before


def test_scenario_of_another_command_before(iout, tmp_path):
    own = tmp_path / "own.json"
    own.write_text('{"extends": "best/k3-fdd"}')
    assert iout("show", own)[0] == 0
    assert iout("evaluate", "paper/k3-fdd", *PLAY, "--json", own)[0] == 0
    assert json.loads(own.read_text())["episodes"] == 1
    (tmp_path / "empty.json").touch()
    assert iout("schema", "--output", tmp_path / "empty.json")[0] == 0


@pytest.mark.slow
class TestOtherDrives:
    """On Windows no way leads from one drive to another: `os.path.relpath` raises ValueError."""

    @pytest.fixture(autouse=True)
    def drives(self, monkeypatch):
        def relpath(path, start=None):
            raise ValueError("path is on mount 'C:', start on mount 'D:'")

        monkeypatch.setattr(os.path, "relpath", relpath)

    def test_what_a_scenario_extends(self, iout, own, tmp_path):
        (tmp_path / "n.csv").write_text("x,y,z\n0,0,0\n")
        for path, *words in (
            ("new.yaml", "new", "new.yaml"),
            ("made.yaml", "scenario", "from-nodes", "n.csv", "--out", "made.yaml"),
        ):
            assert iout(*words, "--from", own.name)[0] == 0
            assert f"extends: {own.as_posix()}\n" in (tmp_path / path).read_text()

    def test_figures_of_a_report(self, iout, tmp_path):
        made = results([("g", "greedy", 3, record("greedy", 3, 0, {}))], report="plain")
        (tmp_path / "results.json").write_text(made.to_json())
        assert iout("report", tmp_path, "--markdown", tmp_path / "mine.md")[0] == 0
        assert f"]({tmp_path.as_posix()}/figures/" in (tmp_path / "mine.md").read_text()

    def test_a_scenario_that_a_study_does_not_find(self, refused, own, tmp_path):
        (tmp_path / "studies").mkdir()
        group = {"scenarios": ["own"], "policies": ["greedy"]}
        path = write_study(tmp_path / "studies" / "s.yaml", groups={"g": group})
        line = refused("reproduce", "--study", path, "--out", "out")
        assert line.endswith(f"from the study's own folder it is '{own}'")


class TestMarkdown:
    @pytest.fixture
    def study(self, tmp_path):
        folder = tmp_path / "out"
        folder.mkdir()
        made = results([("g", "greedy", 3, record("greedy", 3, 0, {}))], report="plain")
        (folder / "results.json").write_text(made.to_json())
        return folder

    @pytest.mark.parametrize(
        "name",
        ["results.json", "results.csv", "report.html", "study.json", "cells/a.md", "figures/a.md"],
    )
    def test_files_of_a_study(self, refused, study, name):
        (study / "cells").mkdir(exist_ok=True)
        (study / "figures").mkdir(exist_ok=True)
        before = contents(study)
        line = refused("report", study, "--markdown", study / name)
        if name.endswith(".md"):
            told = f"{study / name}: cannot be written: it is a file of the study in {study}"
            assert line == told
        else:
            assert f"{study / name}: must end in .md" in line
        assert contents(study) == before

    @pytest.mark.slow
    def test_results_by_another_name(self, refused, study, tmp_path):
        (tmp_path / "link.md").symlink_to("out/results.json")
        os.link(study / "results.json", tmp_path / "hard.md")
        before = (study / "results.json").read_bytes()
        assert "is a file of the study" in refused("report", study, "--markdown", "link.md")
        assert READ in refused("report", study, "--markdown", "hard.md")
        assert (study / "results.json").read_bytes() == before

    @pytest.mark.slow
    def test_where_it_usually_goes(self, iout, study):
        assert iout("report", study, "--markdown", study / "report.md")[0] == 0
        assert iout("report", study, "--markdown", study / "mine.md")[0] == 0
