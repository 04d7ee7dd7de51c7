"""Bad input: exit status 2, one clear line on standard error, nothing else."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import torch

import trainers


@pytest.fixture(autouse=True)
def _working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def finished(tmp_path_factory, tiny):
    folder = tmp_path_factory.mktemp("finished") / "run"
    trainers.train(tiny(), folder, evaluation_episodes=1)
    return folder


@pytest.fixture
def folder(finished, tmp_path):
    return shutil.copytree(finished, tmp_path / "run")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["sho"], "No such command 'sho'"),
        (["--verbose"], "No such option: --verbose"),
        (["show"], "Missing argument 'SCENARIO'"),
        (["show", "paper/k3-fdd", "paper/k5-fdd"], "unexpected extra argument"),
        (["show", "paper/k3-fdd", "--sett", "a=1"], "No such option: --sett"),
        (["show", "paper/k3-fdd", "--set"], "Option '--set' requires an argument"),
        (["scenarios", "x"], "unexpected extra argument"),
        (["evaluate", "paper/k3-fdd", "--episodes", "0"], "Invalid value for '--episodes'"),
        (["evaluate", "paper/k3-fdd", "--episodes", "-3"], "Invalid value for '--episodes'"),
        (["evaluate", "paper/k3-fdd", "--episodes", "many"], "Invalid value for '--episodes'"),
        (["evaluate", "paper/k3-fdd", "--episodes", "1.5"], "Invalid value for '--episodes'"),
        (["evaluate", "paper/k3-fdd", "--seed", "-1"], "Invalid value for '--seed'"),
        (["train", "paper/k3-fdd", "--seed", "-1"], "Invalid value for '--seed'"),
        (["train", "paper/k3-fdd", "--seed", str(2**64)], "Invalid value for '--seed'"),
        (["train", "paper/k3-fdd", "--steps", "0"], "Invalid value for '--steps'"),
        (["train", "paper/k3-fdd", "--threads", "0"], "Invalid value for '--threads'"),
    ],
)
def test_command_line_that_cannot_be_read(refused, words, expected):
    line = refused(*words)
    assert expected in line
    assert line.endswith("(see: iout --help)")


@pytest.mark.slow
@pytest.mark.parametrize("command", ["show", "train", "evaluate"])
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["paper/k3-fd"], "no scenario 'paper/k3-fd': neither a file nor a bundled name; did you"),
        (["missing.yaml"], "no scenario 'missing.yaml'"),
        (["bad.yaml"], "bad.yaml:2: age.inital: unknown key; did you mean 'initial'?"),
        (["broken.yaml"], "broken.yaml:2: broken YAML: "),
        (["latin.yaml"], "latin.yaml: cannot be read: not UTF-8 text"),
        (["folder"], "no scenario 'folder'"),
        (["x" * 5000], "no scenario 'xxx"),
        (["paper/k3-fdd", "--set", "age.maximum"], "--set age.maximum: must be of the form key=v"),
        (["paper/k3-fdd", "--set", "age.maximum=0"], "--set age.maximum=0: age.maximum: must be "),
        (["paper/k3-fdd", "--set", "age=\n"], "--set age=\\n: age: must be a mapping of keys to"),
        (["paper/k3-fdd", "--set", "training.preset=fats"], "no training preset 'fats'; did you"),
        (["paper/k3-fdd", "--set", "grid.spacing_m=.nan"], "grid.spacing_m: must be a finite num"),
    ],
)
def test_bad_scenario(refused, tmp_path, command, words, expected):
    (tmp_path / "folder").mkdir()
    (tmp_path / "bad.yaml").write_text("extends: paper/k3-fdd\nage: {inital: 1}")
    (tmp_path / "broken.yaml").write_text("a: [1\nb: 2\n")
    (tmp_path / "latin.yaml").write_bytes("name: Dörte".encode("latin-1"))
    assert expected in refused(command, *words)
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    ("policy", "expected"),
    [
        ("gredy", "neither a baseline nor the folder of a run; did you mean 'greedy'?"),
        ("", "neither a baseline nor the folder of a run"),
        ("missing/run", "neither a baseline nor the folder of a run"),
        ("x" * 5000, "neither a baseline nor the folder of a run"),
        ("a\nb", "--policy a\\nb: neither a baseline"),
        (".", "holds no trained policy"),
    ],
)
def test_bad_policy(refused, policy, expected):
    assert expected in refused("evaluate", "paper/k3-fdd", "--policy", policy)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--policy", "tour", "--planner-seconds", "3"], "no planner without --policy planner"),
        (["--planner-start", "greedy"], "no planner without --policy planner"),
        (
            ["--policy", "planner", "--planner-seconds", "3", "--planner-rounds", "1"],
            "either rounds or seconds",
        ),
        (["--policy", "planner", "--planner-seconds", "-3"], "seconds must be 0 or more, not -3.0"),
        (["--policy", "planner", "--planner-rounds", "-3"], "must be at least 0, not -3"),
        (["--policy", "planner", "--planner-start", "gredy"], "--planner-start gredy: neither"),
    ],
)
def test_bad_budget_of_a_planner(refused, words, expected):
    assert expected in refused("evaluate", "paper/k3-fdd", *words)


def test_one_bad_policy_among_good_ones(refused):
    words = ["--episodes", 1, "--policy", "greedy", "--policy", "gredy"]
    assert "did you mean 'greedy'?" in refused("evaluate", "paper/k3-fdd", *words)


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("missing/x.json", "missing/x.json: cannot be written: missing is no folder"),
        ("file/x.json", "file/x.json: cannot be written: file is no folder"),
        (".", ".: cannot be written: is a folder, not a file"),
        ("", "must name a file, not be empty"),
        ("  ", "must name a file, not be empty"),
    ],
)
def test_json_that_cannot_be_written_is_refused_before_anything_is_played(
    refused, tmp_path, path, expected
):
    (tmp_path / "file").touch()
    assert expected in refused("evaluate", "paper/k3-fdd", "--json", path)


def test_json_that_cannot_be_written_leaves_the_table(iout):
    words = ["--policy", "greedy", "--episodes", 1, "--json", "x" * 300 + ".json"]
    status, out, err = iout("evaluate", "paper/k3-fdd", *words)
    assert status == 2
    assert "mean AoI" in out
    assert "cannot be written: " in err
    assert err.count("\n") == 1


class TestRuns:
    @pytest.fixture(autouse=True)
    def _words(self, tiny_settings):
        self.scenario = ["best/k3-fdd", *tiny_settings]

    def test_existing_run(self, refused, folder):
        line = refused("train", *self.scenario, "--out", folder)
        assert "holds a run already; continue with it by --resume" in line

    def test_folder_that_cannot_be_made(self, refused, tmp_path):
        (tmp_path / "file").touch()
        assert "cannot be made" in refused("train", *self.scenario, "--out", "file/run")

    def test_name_that_is_too_long(self, refused):
        line = refused("train", *self.scenario, "--set", f"name={'x' * 300}")
        assert line.endswith("cannot be made: File name too long")

    @pytest.mark.parametrize(
        ("key", "value", "expected"),
        [
            ("imitate", "gredy", "gredy: neither a baseline nor the folder of a run; did you mean"),
            ("optimizer", "Zzz", ": torch.optim has no optimizer 'Zzz' (known: "),
        ],
    )
    def test_what_the_training_alone_can_check(self, refused, key, value, expected):
        Path("mine.yaml").write_text(f"extends: best/k3-fdd\ntraining:\n  {key}: {value}\n")
        line = refused("train", "mine.yaml", *self.scenario[1:])
        assert line.startswith(f"mine.yaml:3: training.{key}")
        assert expected in line
        line = refused("train", *self.scenario, "--set", f"training.{key}={value}")
        assert line.startswith(f"--set training.{key}={value}: training.{key}")

    @pytest.mark.parametrize("name", ["missing", "", "x" * 5000])
    def test_nothing_to_resume(self, refused, name):
        assert refused("train", *self.scenario, "--resume", name)

    def test_two_folders(self, refused, folder):
        line = refused("train", *self.scenario, "--out", "other", "--resume", folder)
        assert line.startswith("--out and --resume name different folders")

    def test_run_of_another_scenario(self, refused, folder):
        words = ["--set", "age.maximum=14"]
        line = refused("train", *self.scenario, *words, "--resume", folder)
        assert line.endswith("is a run of another scenario, best/k3-fdd: age.maximum differs")
        line = refused("evaluate", *self.scenario, *words, "--policy", folder)
        assert line.endswith("age.maximum differs; --transfer evaluates it all the same")

    def test_run_that_does_not_fit_by_transfer(self, refused, folder):
        line = refused("evaluate", "paper/k10-tdd", "--policy", folder, "--transfer")
        assert "do not fit; it needs nodes.count 2, not 10; duplex.kind fdd, not tdd" in line

    def test_run_without_a_checkpoint(self, refused, folder):
        (folder / "checkpoint.pt").unlink()
        assert "holds no checkpoint" in refused("train", *self.scenario, "--resume", folder)

    def test_damaged_checkpoint(self, refused, folder):
        (folder / "checkpoint.pt").write_bytes(b"PK\3\4 and more")
        line = refused("train", *self.scenario, "--resume", folder)
        assert "checkpoint.pt: " in line

    def test_pickled_object(self, refused, folder):
        (folder / "run.json").unlink()  # by whose checksum it would be refused unread
        torch.save({"format": 1, "x": slice}, folder / "checkpoint.pt")
        line = refused("train", *self.scenario, "--resume", folder)
        assert "checkpoint.pt: refused: " in line

    def test_damaged_policy(self, refused, folder):
        data = (folder / "policy.safetensors").read_bytes()
        (folder / "policy.safetensors").write_bytes(data[:100])
        line = refused("evaluate", *self.scenario, "--policy", folder)
        assert "policy.safetensors: cannot be read: " in line

    @pytest.mark.parametrize("device", ["gpu", "cuda:99", "meta", ""])
    def test_device_that_is_not_there(self, refused, device, tmp_path):
        line = refused("train", *self.scenario, "--device", device)
        assert line.startswith(f"--device {device}: ")
        assert not (tmp_path / "runs").exists()

    def test_cuda_where_there_is_none(self, refused, monkeypatch):
        monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
        line = refused("train", *self.scenario, "--device", "cuda")
        assert line == "--device cuda: this machine has no such device"


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        (OSError(5, "Input/output error", "some/file"), "some/file: Input/output error"),
        (MemoryError(), "not enough memory"),
        (ValueError("Maximum allowed dimension exceeded"), "not enough memory"),
        (RuntimeError("[enforce fail] DefaultCPUAllocator: out of memory"), "not enough memory"),
        (ValueError("array is larger: exceeds the maximum size"), "not enough memory"),
    ],
)
def test_what_the_machine_refuses(refused, monkeypatch, error, expected):
    def fail():
        raise error

    monkeypatch.setattr("iout_marl.cli_show.bundled_names", fail)
    assert refused("scenarios") == expected


@pytest.mark.slow
def test_as_a_process_too(tmp_path):
    command = [sys.executable, "-m", "iout_marl", "show", "paper/k3-fd"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr == (
        "iout: no scenario 'paper/k3-fd': neither a file nor a bundled name; "
        "did you mean 'paper/k3-fdd' or 'paper/k7-fdd' or 'paper/k5-fdd'? (see: iout scenarios)\n"
    )
