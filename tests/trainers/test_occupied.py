"""Two trainings in one folder: one trains, the other one says why it does not."""

import io

import pytest
from forked import Iout
from rich.console import Console
from tiny_study import wait_for

from iout_marl import InputError
from iout_marl.scenario import to_yaml
from trainers import RunFolder, Trainer, train
from trainers.runs import occupied

pytestmark = pytest.mark.slow

#: A training that waits in its first iteration until its standard input ends.
WAITING = """
import sys
from trainers import Trainer
iterate = Trainer.iterate_all

def wait_and_iterate(trainer):
    print("training", flush=True)
    sys.stdin.read()
    Trainer.iterate_all = iterate
    return iterate(trainer)

Trainer.iterate_all = wait_and_iterate
"""


def quietly(scenario, folder, **options):
    quiet = {"console": Console(file=io.StringIO()), "evaluation_episodes": 1}
    return train(scenario, folder, **quiet, **options)


@pytest.fixture(autouse=True)
def _no_patience(monkeypatch):
    """Who really trains in a folder does so for longer than any glance."""
    monkeypatch.setattr(occupied, "GLANCE_S", 0.1)


@pytest.fixture
def other(tiny, tmp_path):
    """Starts a training in another process, which continues as its input is closed."""
    processes = []
    source = tmp_path / "scenario.yaml"
    source.write_text(to_yaml(tiny()), encoding="utf-8")

    def start(*words):
        processes.append(Iout(["train", source, *words], before=WAITING))
        return processes[-1]

    yield start
    for process in processes:
        with process:
            process.kill()


def is_training(process):
    assert process.stdout.readline() == "training\n", process.stderr.read()


BUSY = "another process is training in it; wait for it, or name another folder by --out"


def test_second_one_says_so_and_the_first_one_trains(other, tiny, tmp_path):
    run = tmp_path / "run"
    first = other("--out", run)
    is_training(first)
    for options in ({}, {"resume": True}, {"replicas": 2}):
        with pytest.raises(InputError, match=BUSY):
            quietly(tiny(), run, **options)
    _, err = first.communicate()
    assert first.returncode == 0, err
    assert RunFolder(run).policy_shape()["env_steps"] == 560


def test_lock_of_a_dead_process_does_not_block(other, tiny, tmp_path):
    first = other("--out", tmp_path / "run")
    is_training(first)
    first.kill()
    first.wait()
    assert (tmp_path / "run/.lock").exists()
    assert quietly(tiny(), tmp_path / "run").finished


def test_group_and_one_of_its_policies(other, tiny, tmp_path):
    group = tmp_path / "group"
    quietly(tiny({"training.steps": 240}), group, replicas=2)
    first = other("--resume", group)
    is_training(first)
    for name in ("seed-0", "seed-1"):
        with pytest.raises(InputError, match=f"group: {BUSY}"):
            quietly(tiny(), group / name, resume=True)
    with pytest.raises(InputError, match=f"group: {BUSY}"):
        quietly(tiny(), group / "seed-2")
    first.communicate()
    assert first.returncode == 0
    first = other("--resume", group / "seed-1", "--steps", "800")
    is_training(first)
    with pytest.raises(InputError, match=f"seed-1: {BUSY}"):
        quietly(tiny({"training.steps": 800}), group, resume=True)
    assert quietly(tiny({"training.steps": 800}), group / "seed-0", resume=True).finished


def test_group_that_has_not_saved_yet(other, tiny, tmp_path):
    first = other("--out", tmp_path / "group", "--replicas", "2")
    is_training(first)
    with pytest.raises(InputError, match=f"group: {BUSY}"):
        quietly(tiny(), tmp_path / "group/seed-0")


def test_of_many_that_start_at_once_one_trains(other, tmp_path):
    several = [other("--out", tmp_path / "run") for _ in range(3)]
    for process in several:
        process.stdin.close()
    wait_for(lambda: all(process.poll() is not None for process in several))
    errors = [process.stderr.read() for process in several if process.returncode]
    assert len(errors) == 2
    assert all(BUSY in error or "holds a run already" in error for error in errors)
    assert RunFolder(tmp_path / "run").policy_shape()["env_steps"] == 560


def test_folder_that_is_refused_gets_no_lock(tiny, tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "run/policy.json").write_text("{}")
    with pytest.raises(InputError, match="holds a run already"):
        quietly(tiny(), tmp_path / "run")
    assert {path.name for path in (tmp_path / "run").iterdir()} == {"policy.json"}


def test_lock_is_let_go_of_when_a_training_fails(tiny, tmp_path, monkeypatch):
    def fail(trainer):
        raise InputError("it fails")

    with monkeypatch.context() as patch:
        patch.setattr(Trainer, "iterate_all", fail)
        with pytest.raises(InputError, match="it fails"):
            quietly(tiny(), tmp_path / "run")
    assert quietly(tiny(), tmp_path / "run").finished
