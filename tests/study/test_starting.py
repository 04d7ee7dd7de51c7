"""The folder of a study as it begins: what a killed start has left, and who is there first."""

import threading

import pytest
from tiny_study import SameProcess, write_study

from iout_marl import InputError
from iout_marl.files import locked
from iout_marl.study import expand, load_study, run_study
from iout_marl.study.run import StudyFolder

IDENTITY = {"name": "tiny", "title": "A tiny study", "overrides": [], "quick": False}


def made(folder, names):
    """Makes files and, where a name ends in a slash, folders."""
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if name.endswith("/"):
            path.mkdir(exist_ok=True)
        else:
            path.write_text("" if path.name == ".lock" else "what was there")
    return {path: path.is_file() and path.read_text() for path in folder.rglob("*")}


@pytest.mark.slow
@pytest.mark.parametrize(
    "left",
    [
        (),
        (".lock",),
        (".lock", "cells/"),
        (".lock", "cells/", "runs/"),
        (".lock", "cells/", "runs/", "study.json.part"),
        ("study.json.part",),
    ],
)
def test_what_a_killed_start_has_left_is_no_obstacle(tmp_path, left):
    out = tmp_path / "out"
    out.mkdir()
    made(out, left)
    study = load_study(write_study(tmp_path / "tiny.yaml"))
    cells = expand(*study)[:1]
    folder = StudyFolder(out)
    with folder.open(IDENTITY):
        results = run_study("tiny", study[0], cells, folder, SameProcess(), "iout reproduce")
    assert len(results.cells) == 1
    assert not list(out.rglob("*.part"))


@pytest.mark.parametrize(
    ("there", "named"),
    [
        (("thesis.tex",), "thesis.tex"),
        ((".lock", "thesis.tex"), "thesis.tex"),
        (("cells/mine.json",), "cells"),
        (("runs/paper/policy.json", "cells/"), "runs"),
        ((".git/config",), ".git"),
        (("results.json",), "results.json"),
        (("movie.part",), "movie.part"),
    ],
)
def test_a_folder_of_something_else_stays_as_it_is(tmp_path, there, named):
    before = made(tmp_path, there)
    with (
        pytest.raises(InputError, match=f"holds no study, but {named}; name a new or empty"),
        StudyFolder(tmp_path).open(IDENTITY),
    ):
        pass
    assert {path: path.is_file() and path.read_text() for path in tmp_path.rglob("*")} == before


def test_a_file_in_the_place_of_the_folder_is_told(tmp_path):
    (tmp_path / "out").write_text("a file")
    with (
        pytest.raises(InputError, match="out: cannot be read: Not a directory"),
        StudyFolder(tmp_path / "out").open(IDENTITY),
    ):
        pass


def test_of_two_that_begin_at_once_the_second_is_told_that_the_first_is_there(tmp_path):
    with (
        locked(tmp_path, "not this time"),
        pytest.raises(InputError, match="another study is running in it"),
        StudyFolder(tmp_path).open(IDENTITY),
    ):
        pass


def test_of_many_that_begin_at_once_one_runs(tmp_path):
    told, begun, end = [], [], threading.Event()
    gate = threading.Barrier(8)

    def begin():
        gate.wait()
        try:
            with StudyFolder(tmp_path / "out").open(IDENTITY):
                begun.append(True)
                end.wait()
        except InputError as error:
            told.append(str(error))
            if len(told) == 7:
                end.set()

    threads = [threading.Thread(target=begin) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(begun) == 1
    assert {line.partition(": ")[2] for line in told} == {"another study is running in it"}


def test_another_study_that_began_meanwhile_is_seen(tmp_path, monkeypatch):
    """Between the first look and the lock another one may have come and gone."""
    first = StudyFolder(tmp_path / "out")
    look = StudyFolder._check

    def slow_look(self, wanted):
        look(self, wanted)
        if not (self.path / "study.json").exists():
            monkeypatch.setattr(StudyFolder, "_check", look)
            with first.open({**IDENTITY, "title": "Another"}):
                pass

    monkeypatch.setattr(StudyFolder, "_check", slow_look)
    with (
        pytest.raises(InputError, match="holds a study of another title"),
        StudyFolder(tmp_path / "out").open(IDENTITY),
    ):
        pass


def test_parts_of_files_that_were_being_written_are_cleared_away_and_no_others(tmp_path):
    with StudyFolder(tmp_path).open(IDENTITY):
        pass
    own = ["study.json.part", "results.json.part", "results.csv.part", "report.html.part"]
    own += ["cells/a.json.part", "runs/a/policy.json.part", "figures/a.svg.part"]
    made(tmp_path, [*own, "movie.part", "runs/a/policy.json"])
    with StudyFolder(tmp_path).open(IDENTITY):
        left = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.*")}
    assert left == {".lock", "study.json", "movie.part", "runs/a/policy.json"}


def test_a_marker_that_says_nothing_is_told(tmp_path):
    for text, message in (
        ("", "damaged, it is no JSON"),
        ("[]", "it is no file of a study"),
        ('{"format": 1, "world_version": 0}', "name: Field required"),
        ('{"format": 9, "world_version": 0}', "is of another version of this software: format 9"),
    ):
        (tmp_path / "study.json").write_text(text)
        with (
            pytest.raises(InputError, match=message) as error,
            StudyFolder(tmp_path).open(IDENTITY),
        ):
            pass
        assert str(error.value).endswith("; name another folder by --out")
        assert [path.name for path in tmp_path.iterdir()] == ["study.json"]
