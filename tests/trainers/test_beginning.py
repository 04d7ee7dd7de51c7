"""A training begins: it clears away what a run that never saved has left, and nothing else."""

import io
import os
import shutil
import signal

import forked
import pytest
from rich.console import Console
from tiny_study import PATIENCE_S

from iout_marl import InputError
from trainers import RunFolder, Trainer, train
from trainers.runs import saving

MARKS = {"run.json.begun", "group.json.begun"}
EVENTS = "events.out.tfevents.1700000000.elsewhere.1.0"
#: Names under which a run writes something before it has saved, or while it does.
LEFTOVERS = ["metrics.jsonl", "metrics.jsonl.part", EVENTS, "run.json.part", "checkpoint.pt.part"]
SIGNALS = [getattr(signal, n) for n in ("SIGHUP", "SIGINT", "SIGTERM") if hasattr(signal, n)]
REFUSAL = "cannot be used: it holds {}, which is not known to be a leftover of a run; name another"


class KilledError(Exception):
    """A process that ends as nothing has foreseen."""


def quietly(scenario, folder, **options):
    quiet = {"console": Console(file=io.StringIO()), "evaluation_episodes": 1}
    return train(scenario, folder, **quiet, **options)


def contents(folder):
    return {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.fixture
def killed(tiny, monkeypatch):
    """Begins a training that ends before its first save."""

    def begin(folder, iterations=2, **options):
        iterate, left = Trainer.iterate_all, [iterations]

        def iterate_or_end(trainer):
            if not left[0]:
                raise KilledError
            left[0] -= 1
            return iterate(trainer)

        with monkeypatch.context() as patch:
            patch.setattr(Trainer, "iterate_all", iterate_or_end)
            with pytest.raises(KilledError):
                quietly(tiny(), folder, **options)

    return begin


@pytest.fixture(scope="module")
def finished(tiny, tmp_path_factory):
    folder = tmp_path_factory.mktemp("finished") / "run"
    quietly(tiny(), folder)
    (folder / ".lock").unlink()
    return folder


class TestFilesOfOthers:
    @pytest.mark.parametrize("name", ["scenario.yaml", "scenario.yaml.part", *LEFTOVERS])
    def test_under_a_name_that_a_run_writes(self, tiny, tmp_path, name):
        (tmp_path / name).write_text("mine")
        with pytest.raises(InputError, match=REFUSAL.format(name)):
            quietly(tiny(), tmp_path)
        assert contents(tmp_path) == {tmp_path / name: b"mine"}

    @pytest.mark.parametrize(
        "name", ["seed-4/scenario.yaml", f"seed-4/{EVENTS}", "group.json.part"]
    )
    def test_where_several_policies_would_be(self, tiny, tmp_path, name):
        (tmp_path / "seed-4").mkdir()
        (tmp_path / name).write_text("mine")
        with pytest.raises(InputError, match=REFUSAL.format(name.removeprefix("seed-4/"))):
            quietly(tiny(), tmp_path, seed=3, replicas=2)
        assert contents(tmp_path) == {tmp_path / name: b"mine"}

    def test_link_that_leads_nowhere_is_one(self, tiny, tmp_path):
        (tmp_path / "metrics.jsonl").symlink_to("nowhere")
        with pytest.raises(InputError, match=REFUSAL.format("metrics.jsonl")):
            quietly(tiny(), tmp_path)
        assert not (tmp_path / "nowhere").exists()

    def test_scenario_that_is_trained_from(self, refused, tiny_settings, tmp_path):
        text = "# my comments\nextends: best/k3-fdd\n"
        (tmp_path / "scenario.yaml").write_text(text)
        words = ["train", tmp_path / "scenario.yaml", *tiny_settings, "--out", tmp_path]
        assert REFUSAL.format("scenario.yaml") in refused(*words)
        assert contents(tmp_path) == {tmp_path / "scenario.yaml": text.encode()}

    def test_that_came_after_a_run_which_never_saved(self, tiny, tmp_path, killed):
        killed(tmp_path)
        (tmp_path / "scenario.yaml").write_text("mine")
        before = contents(tmp_path)
        with pytest.raises(InputError, match=REFUSAL.format("scenario.yaml")):
            quietly(tiny(), tmp_path)
        assert contents(tmp_path) == before

    @pytest.mark.slow
    def test_of_other_names_stay(self, tiny, tmp_path):
        mine = {tmp_path / name: b"mine" for name in ("notes.txt", "my.yaml", "metrics.json")}
        for path, data in mine.items():
            path.write_bytes(data)
        quietly(tiny(), tmp_path)
        assert contents(tmp_path).items() >= mine.items()

    @pytest.mark.slow
    def test_beside_the_folders_of_several_policies_stay(self, tiny, tmp_path):
        mine = {tmp_path / name: b"mine" for name in ("scenario.yaml", "metrics.jsonl", EVENTS)}
        for path, data in mine.items():
            path.write_bytes(data)
        quietly(tiny({"training.steps": 80}), tmp_path, seed=3, replicas=2)
        assert quietly(tiny(), tmp_path, resume=True).trainer.env_steps == 560
        assert contents(tmp_path).items() >= mine.items()

    def test_lock_of_another_program(self, tiny, tmp_path):
        (tmp_path / ".lock").write_text("mine")
        with pytest.raises(InputError, match=r"\.lock: is of another program"):
            quietly(tiny(), tmp_path)
        assert contents(tmp_path) == {tmp_path / ".lock": b"mine"}


class TestLeftovers:
    @pytest.mark.slow
    @pytest.mark.parametrize("iterations", [0, 2])
    def test_run_that_never_saved_may_start_again(self, tiny, tmp_path, killed, iterations):
        killed(tmp_path / "run", iterations)
        for name in saving.NAMES:
            (tmp_path / f"run/{name}.part").write_text("half")
        with pytest.raises(InputError, match="nothing has been saved in it yet; start anew"):
            quietly(tiny(), tmp_path / "run", resume=True)
        quietly(tiny(), tmp_path / "run")
        assert len(RunFolder(tmp_path / "run").metrics_path.read_text().splitlines()) == 7
        assert len(list((tmp_path / "run").glob("events.*"))) == 1
        assert not list((tmp_path / "run").glob("*.part"))

    @pytest.mark.slow
    def test_several_policies_that_never_saved(self, tiny, tmp_path, killed):
        killed(tmp_path / "group", seed=3, replicas=2)
        (tmp_path / "group/group.json.part").write_text("half")
        assert {path.name for path in tmp_path.rglob("*.begun")} == MARKS
        quietly(tiny(), tmp_path / "group", seed=3, replicas=2)
        lines = [len(path.read_text().splitlines()) for path in tmp_path.rglob("metrics.jsonl")]
        assert lines == [7, 7]

    def test_lone_run_where_several_policies_never_saved(self, tiny, tmp_path, killed):
        killed(tmp_path, seed=3, replicas=2)
        (tmp_path / "metrics.jsonl").write_text("mine")
        with pytest.raises(InputError, match=REFUSAL.format("metrics.jsonl")):
            quietly(tiny(), tmp_path)

    @pytest.mark.slow
    @pytest.mark.parametrize("replicas", [1, 2])
    def test_a_save_takes_the_mark_away(self, tiny, tmp_path, replicas):
        quietly(tiny(), tmp_path / "run", replicas=replicas)
        assert not list(tmp_path.rglob("*.begun"))

    def test_mark_that_a_kill_after_the_save_has_left_allows_nothing(self, tiny, tmp_path):
        quietly(tiny({"training.steps": 80}), tmp_path)
        (tmp_path / "run.json.begun").touch()
        before = contents(tmp_path)
        with pytest.raises(InputError, match="holds a run already"):
            quietly(tiny(), tmp_path)
        assert contents(tmp_path) == before
        assert quietly(tiny(), tmp_path, resume=True).finished
        assert not (tmp_path / "run.json.begun").exists()


class TestRefusedFolders:
    """They are left as they were: without a lock, too."""

    @pytest.mark.parametrize("exists", [True, False])
    def test_resumed_without_a_run(self, tiny, tmp_path, exists):
        folder = tmp_path / "folder"
        if exists:
            folder.mkdir()
            (folder / "notes.txt").touch()
        before = sorted(tmp_path.rglob("*"))
        with pytest.raises(InputError, match="holds no run"):
            quietly(tiny(), folder, resume=True)
        assert sorted(tmp_path.rglob("*")) == before

    @pytest.mark.parametrize(
        ("changes", "resume"),
        [({}, False), ({"training.steps": 1}, True), ({"age.maximum": 14}, True)],
        ids=["used", "fewer steps", "another scenario"],
    )
    def test_of_a_run(self, finished, tiny, tmp_path, changes, resume):
        folder = shutil.copytree(finished, tmp_path / "run")
        before = contents(folder)
        with pytest.raises(InputError):
            quietly(tiny(changes), folder, resume=resume)
        assert contents(folder) == before

    def test_without_a_checkpoint(self, finished, tiny, tmp_path):
        folder = shutil.copytree(finished, tmp_path / "run")
        (folder / "checkpoint.pt").unlink()
        with pytest.raises(InputError, match="holds no checkpoint"):
            quietly(tiny(), folder, resume=True)
        assert not (folder / ".lock").exists()

    def test_before_a_trainer_is_built(self, finished, tiny, monkeypatch):
        def build(*_, **__):
            raise AssertionError("it is built first")

        monkeypatch.setattr(Trainer, "__init__", build)
        with pytest.raises(InputError, match="holds a run already"):
            quietly(tiny(), finished)
        with pytest.raises(InputError, match="has taken 560 steps already"):
            quietly(tiny({"training.steps": 1}), finished, resume=True)


class TestWhichPoliciesAreMeant:
    """Where several lie in a folder, what they were saved with says so."""

    @pytest.mark.slow
    def test_another_run_among_them_is_none_of_them(self, tiny, tmp_path):
        quietly(tiny({"training.steps": 80}), tmp_path, seed=3, replicas=2)
        shutil.copytree(tmp_path / "seed-4", tmp_path / "seed-5")
        outcome = quietly(tiny(), tmp_path, resume=True)
        assert [run.path.name for run in outcome.runs] == ["seed-3", "seed-4"]
        assert RunFolder(tmp_path / "seed-5").policy_shape()["env_steps"] == 80

    @pytest.mark.slow
    @pytest.mark.parametrize("steps", [(560,), (480, 560)], ids=["one", "both"])
    def test_that_have_been_trained_alone(self, tiny, tmp_path, steps):
        quietly(tiny({"training.steps": 480}), tmp_path, seed=3, replicas=2)
        for seed, _ in enumerate(steps, start=3):
            quietly(tiny(), tmp_path / f"seed-{seed}", resume=True)
        fault = "have been trained alone since they were trained side by side"
        if len(steps) == 1:
            fault = "have not come equally far, but 480 to 560 steps"
        with pytest.raises(InputError, match=f"these runs {fault}; continue with each by its own"):
            quietly(tiny({"training.steps": 640}), tmp_path, resume=True)

    @pytest.mark.slow
    def test_that_is_missing(self, tiny, tmp_path):
        quietly(tiny(), tmp_path, seed=3, replicas=2)
        shutil.rmtree(tmp_path / "seed-4")
        with pytest.raises(InputError, match=r"seed-4/run\.json: is missing, but named by group"):
            quietly(tiny({"training.steps": 640}), tmp_path, resume=True)
        os.unlink(tmp_path / "group.json")  # noqa: PTH108
        with pytest.raises(InputError, match="are not all that were trained side by side"):
            quietly(tiny({"training.steps": 640}), tmp_path, resume=True)


#: The command line, whose trainer takes long to build: in a library that looks at no signal.
ENDLESS = """
import hashlib
from trainers import Trainer

def build(*_, **__):
    print("building", flush=True)
    hashlib.pbkdf2_hmac("sha256", b"", b"", 2**31 - 1)

Trainer.__init__ = build
"""


@pytest.mark.slow
@pytest.mark.parametrize("number", SIGNALS, ids=lambda number: number.name)
@pytest.mark.posix
def test_signal_ends_a_training_that_is_only_being_built(tiny_settings, tmp_path, number):
    words = ["train", "best/k3-fdd", *tiny_settings, "--out", str(tmp_path / "run")]
    with forked.Iout(words, before=ENDLESS) as process:
        try:
            assert process.stdout.readline() == "building\n", process.stderr.read()
            process.send_signal(number)
            _, err = process.communicate(timeout=PATIENCE_S)
        finally:
            process.kill()
    assert (process.returncode, err) == (-number, "")
    assert not (tmp_path / "run").exists()


def test_signal_in_a_program_of_somebody_elses(tiny, tmp_path, monkeypatch):
    def build(*_, **__):
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(Trainer, "__init__", build)
    with pytest.raises(KeyboardInterrupt):
        quietly(tiny(), tmp_path / "run")
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
