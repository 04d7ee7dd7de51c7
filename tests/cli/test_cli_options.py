"""Numbers and paths on the command line: what is meant is accepted, or refused in one line."""

import json
import typing
from pathlib import Path

import pytest
import typer

from iout_marl.cli import app


@pytest.fixture(autouse=True)
def _working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    (tmp_path / "home").mkdir()
    (tmp_path / "a file").touch()


EVALUATE = ["evaluate", "paper/k3-fdd", "--policy", "greedy"]


class TestNumbers:
    @pytest.mark.slow
    @pytest.mark.parametrize("text", ["10", "1e1", "1E1", "10.0", "1_0", "+10", "0.1e2", " 10"])
    def test_that_are_whole(self, iout, text):
        status, out, _ = iout(*EVALUATE, "--episodes", text, "--seed", text, "--json", "-")
        assert status == 0
        record = json.loads(out)
        assert (record["episodes"], record["seed"]) == (10, 10)

    def test_of_steps_and_replicas(self, iout, tiny_settings, tmp_path):
        words = ["train", "best/k3-fdd", *tiny_settings, "--out", "run"]
        status, _, _ = iout(*words, "--steps", "1.6e2", "--replicas", "2e0", "--threads", "1.0")
        assert status == 0
        lines = (tmp_path / "run" / "seed-1" / "metrics.jsonl").read_text().splitlines()
        assert json.loads(lines[-1])["env_steps"] == 160

    @pytest.mark.slow
    @pytest.mark.parametrize(
        "words",
        [
            [*EVALUATE, "--episodes"],
            [*EVALUATE, "--seed"],
            ["evaluate", "paper/k3-fdd", "--policy", "planner", "--planner-rounds"],
            ["train", "paper/k3-fdd", "--steps"],
            ["train", "paper/k3-fdd", "--seed"],
            ["train", "paper/k3-fdd", "--threads"],
            ["train", "paper/k3-fdd", "--replicas"],
            ["bound", "paper/k3-fdd", "--seed"],
            ["reproduce", "--jobs"],
        ],
        ids=lambda words: f"{words[0]} {words[-1]}",
    )
    @pytest.mark.parametrize(
        ("text", "reason"),
        [
            ("1.5", "must be a whole number, not 1.5"),
            ("1e-1", "must be a whole number"),
            ("many", "must be a whole number, not 'many'"),
            ("", "must be a whole number, not ''"),
            ("nan", "must be a whole number, not 'nan'"),
            ("-1", "must be at least "),
            ("-1e300", "must be at least "),
            ("1e30", "must be at most "),
            ("1e999999999", "must be at most "),
            ("1e-999999999", "must be "),  # a whole number, or at least 1
            ("2.00000000000000000000000000000000001", "must be a whole number"),
            ("9" * 6000, "must be at most "),
            ("Infinity", "must be a whole number"),
            ("0x10", "must be a whole number"),
        ],
    )
    def test_that_are_not(self, refused, words, text, reason):
        line = refused(*words, text)
        assert line.startswith(f"Invalid value for '{words[-1]}': ")
        if (text, reason) != ("1e-1", "must be a whole number"):
            assert reason in line
        assert len(line) < 200


PATHS = [
    (["train", "paper/k3-fdd", "--out"], "a folder"),
    (["train", "paper/k3-fdd", "--resume"], "a folder"),
    ([*EVALUATE, "--json"], "a file"),
    (["bound", "paper/k3-fdd", "--json"], "a file"),
    (["reproduce", "--out"], "a folder"),
    (["report", "runs", "--markdown"], "a file"),
    (["report"], "a folder"),
]


@pytest.mark.parametrize(("words", "what"), PATHS, ids=str)
class TestPaths:
    @pytest.mark.parametrize("text", ["", " ", "\t"])
    def test_that_are_empty(self, refused, tmp_path, words, what, text):
        before = sorted(tmp_path.rglob("*"))
        assert f"must name {what}, not be empty" in refused(*words, text)
        assert sorted(tmp_path.rglob("*")) == before

    def test_of_the_wrong_kind(self, refused, words, what):
        given, kind = ("a file", "is a file, not a folder")
        if what == "a file":
            given, kind = ("home", "is a folder, not a file")
        line = refused(*words, given)
        assert given in line
        assert kind in line

    def test_of_a_home_that_is_not_there(self, refused, words, what):
        assert "there is no such home folder" in refused(*words, "~nobody-at-all/x")


class TestHome:
    def test_folder_of_a_run(self, iout, tiny_settings, tmp_path):
        words = ["train", "best/k3-fdd", *tiny_settings, "--steps", 80]
        assert iout(*words, "--out=~/my run")[0] == 0
        assert (tmp_path / "home" / "my run" / "policy.json").is_file()
        assert not (tmp_path / "~").exists()
        scenario = "~/my run/scenario.yaml"
        status, out, err = iout("evaluate", scenario, "--policy=~/my run", "--json=~/x.json")
        assert status == 0, err
        assert "deterministic" in out
        assert json.loads((tmp_path / "home" / "x.json").read_text())["episodes"] == 1
        assert iout("show", scenario)[0] == 0

    def test_planner_may_start_from_it(self, iout, tiny_settings):
        words = ["best/k3-fdd", *tiny_settings]
        assert iout("train", *words, "--out", "~/run", "--steps", 80)[0] == 0
        words += ["--policy", "planner", "--planner-rounds", 0, "--planner-start=~/run"]
        assert iout("evaluate", *words)[0] == 0

    def test_study(self, refused, tmp_path):
        (tmp_path / "home" / "mine.yaml").write_text("title: [")
        assert "home/mine.yaml" in refused("reproduce", "--study", "~/mine.yaml")


def test_folder_in_a_hint_is_quoted(iout, tiny_settings):
    words = ["train", "best/k3-fdd", *tiny_settings, "--steps", 80, "--out", "a 'b' $c"]
    _, out, _ = iout(*words)
    assert """tensorboard --logdir 'a '"'"'b'"'"' $c'""" in out


def test_every_option_that_is_a_path_is_read_in_the_one_way():
    names = ("out", "resume", "json_file", "markdown", "folder")
    names += ("scenario", "policy", "study", "planner_start")
    read = {}
    for command in typer.main.get_command(app).commands.values():
        for name, hint in typing.get_type_hints(command.callback, include_extras=True).items():
            for option in getattr(hint, "__metadata__", ()):
                read[command.callback.__name__, name] = option.parser
                is_whole = hint.__origin__ in (int, int | None)
                assert option.parser or not (name in names or is_whole), (command, name)
    assert len([name for _, name in read if name in names]) > 10


@pytest.mark.posix
def test_json_may_go_into_a_device_and_through_a_link(iout, tmp_path):
    assert iout(*EVALUATE, "--episodes", 2, "--json", "/dev/null")[0] == 0
    (tmp_path / "link.json").symlink_to("real.json")
    assert iout(*EVALUATE, "--episodes", 2, "--json", "link.json")[0] == 0
    assert json.loads(Path("real.json").read_text())["episodes"] == 2
    assert Path("link.json").is_symlink()
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        *("a file", "home", "link.json", "real.json")
    ]
