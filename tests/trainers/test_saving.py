"""Saves: one state at every moment, damage is seen, and earlier versions are read."""

import io
import json
import os
import shutil
from functools import partial
from pathlib import Path

import pytest
import safetensors.torch
import torch
from rich.console import Console

from iout_marl import InputError, evaluate
from iout_marl.files import user_path
from trainers import RunFolder, Trainer, train
from trainers.runs import saving
from trainers.runs.loading import load_run

#: Run folders as version 0.1 wrote them, without a manifest.
FORMAT_2 = Path(__file__).parent / "format-2"

#: A pipe with a name, which not every system has.
PIPE = pytest.param(getattr(os, "mkfifo", None), marks=pytest.mark.posix)


def quietly(scenario, folder, **options):
    quiet = {"console": Console(file=io.StringIO()), "evaluation_episodes": 3}
    return train(scenario, folder, **quiet, **options)


@pytest.fixture(scope="module")
def finished(tiny, tmp_path_factory):
    folder = tmp_path_factory.mktemp("finished")
    quietly(tiny(), folder / "lone", seed=3)
    quietly(tiny(), folder / "group", seed=3, replicas=2)
    return folder


@pytest.fixture
def lone(finished, tmp_path):
    return shutil.copytree(finished / "lone", tmp_path / "lone")


@pytest.fixture
def group(finished, tmp_path):
    return shutil.copytree(finished / "group", tmp_path / "group")


def contents(folder):
    """Of all files of a folder but locks."""
    return {p: p.read_bytes() for p in folder.rglob("*") if p.is_file() and p.name != ".lock"}


class TestOneMoment:
    """A save, and a reader at each of its writes."""

    @pytest.fixture
    def watched(self, monkeypatch):
        """Lets something happen before everything that a save does on the disk."""

        def watch(happens):
            def after(usual, *args, **kwargs):
                happens()
                return usual(*args, **kwargs)

            for owner, name in ((os, "fsync"), (os, "replace"), (os, "unlink")):
                monkeypatch.setattr(owner, name, partial(after, getattr(owner, name)))

        return watch

    @staticmethod
    def files(round_, names=saving.NAMES):
        return {name: f"{name} {round_}".encode() for name in names}

    def test_of_a_lone_run(self, tmp_path, watched):
        saving.save({tmp_path: self.files(1)})
        seen = []
        watched(lambda: seen.append(saving.read_save(tmp_path)))
        saving.save({tmp_path: self.files(2, saving.NAMES[:-1])})
        old, new = self.files(1), self.files(2, saving.NAMES[:-1])
        changes = seen.index(new)
        assert 0 < changes < len(seen) - 1
        assert seen == [old] * changes + [new] * (len(seen) - changes)
        assert {path.name for path in tmp_path.iterdir()} == {*new, "run.json"}

    def test_of_several_policies(self, tmp_path, watched):
        folders = [tmp_path / f"seed-{i}" for i in (3, 4)]
        for folder in folders:
            folder.mkdir()
        saving.save({folder: self.files(folder.name) for folder in folders}, tmp_path)
        seen = []
        watched(lambda: seen.append([saving.read_save(folder) for folder in folders]))
        saving.save({folder: self.files(f"{folder.name} 2") for folder in folders}, tmp_path)
        old = [self.files(folder.name) for folder in folders]
        new = [self.files(f"{folder.name} 2") for folder in folders]
        changes = seen.index(new)
        assert seen == [old] * changes + [new] * (len(seen) - changes)

    def test_a_result_comes_to_what_was_saved(self, tmp_path):
        saving.save({tmp_path: self.files(1, saving.NAMES[:-1])})
        saving.save({tmp_path: self.files(1, saving.NAMES[-1:])}, adds=True)
        assert saving.read_save(tmp_path) == self.files(1)

    def test_reader_begins_again_when_a_save_comes_in_between(self, tmp_path, monkeypatch):
        saving.save({tmp_path: self.files(1)})
        digest, left = saving.digest, [3]

        def digest_and_save(data):
            left[0] -= 1
            if left[0] == 0:
                saving.save({tmp_path: self.files(2)})
            return digest(data)

        monkeypatch.setattr(saving, "digest", digest_and_save)
        assert saving.read_save(tmp_path) == self.files(2)

    def test_what_a_killed_save_has_left_is_no_part_of_the_next(self, tmp_path):
        saving.save({tmp_path: self.files(1)})
        for name in saving.NAMES:
            (tmp_path / f"{name}.part").write_text("half")
        assert saving.read_save(tmp_path) == self.files(1)
        saving.settle(tmp_path)
        assert not list(tmp_path.glob("*.part"))


class TestDamage:
    @pytest.mark.slow
    @pytest.mark.parametrize("name", [*saving.NAMES, "run.json"])
    @pytest.mark.parametrize("place", [0.0, 0.3, 0.5, 0.99])
    def test_flipped_bit_is_seen(self, lone, tiny, name, place):
        data = bytearray((lone / name).read_bytes())
        data[int(place * len(data))] ^= 1 << 2
        (lone / name).write_bytes(data)
        before = contents(lone)
        for read in (
            RunFolder(lone).load_policy,
            lambda: load_run(lone, tiny(), transfer=False),
            lambda: quietly(tiny(), lone, resume=True),
        ):
            with pytest.raises(InputError) as raised:
                read()
            assert str(raised.value).isprintable()
            assert ": cannot be read: damaged, " in str(raised.value)
        assert contents(lone) == before

    @pytest.mark.slow
    def test_of_what_says_which_policies_belong_together(self, group, tiny):
        path = group / "group.json"
        path.write_bytes(path.read_bytes().replace(b'"format"', b'"fornat"'))
        for read in (
            RunFolder(group / "seed-3").load_policy,
            lambda: quietly(tiny(), group, resume=True),
        ):
            with pytest.raises(InputError, match=r"group\.json: cannot be read: damaged"):
                read()

    def test_manifest_of_another_policy(self, group, tiny):
        shutil.copy(group / "seed-3/run.json", group / "seed-4")
        with pytest.raises(InputError, match=r"seed-4/run\.json: cannot be read: damaged"):
            RunFolder(group / "seed-4").load_policy()

    @pytest.mark.parametrize("more", [{}, {"more": 1}, {"files": []}], ids=str)
    @pytest.mark.parametrize("name", ["run.json", "group.json"])
    def test_manifest_of_a_later_version(self, group, name, more):
        path = group / name if name == "group.json" else group / "seed-3" / name
        data = json.loads(path.read_text())
        path.write_text(json.dumps({**data, "format": 99, **more}))
        (group / "group.json").unlink() if name == "run.json" else None
        with pytest.raises(InputError, match="is of another version of this software: format 99"):
            RunFolder(group / "seed-3").load_policy()

    @pytest.mark.parametrize(
        "text",
        ["", "[]", "null", "[" * 100_000, '{"format": NaN}', '{"format": true, "files": {}}'],
    )
    def test_something_else_in_place_of_a_manifest(self, lone, text):
        (lone / "run.json").write_text(text)
        with pytest.raises(InputError, match=r"run\.json: cannot be read: damaged"):
            RunFolder(lone).load_policy()

    @pytest.mark.slow
    def test_names_do_not_lead_out_of_the_folder(self, lone, tmp_path):
        (tmp_path / "secret").write_text("x")
        data = json.loads((lone / "run.json").read_text())
        data["files"]["../secret"] = saving.digest(b"x")
        (lone / "run.json").write_text(json.dumps(data))
        with pytest.raises(InputError, match="it is no manifest of a run"):
            RunFolder(lone).load_policy()

    def test_checkpoint_that_is_gone_is_missed_by_no_evaluation(self, lone, tiny):
        (lone / "checkpoint.pt").unlink()
        assert RunFolder(lone).load_policy()
        with pytest.raises(InputError, match="holds no checkpoint"):
            quietly(tiny(), lone, resume=True)

    def test_result_that_is_gone_is_made_again(self, lone, finished, tiny):
        (lone / "result.json").unlink()
        quietly(tiny(), lone, resume=True)
        results = [json.loads((f / "result.json").read_text()) for f in (lone, finished / "lone")]
        assert results[0]["evaluation"]["metrics"] == results[1]["evaluation"]["metrics"]

    @pytest.mark.slow
    @pytest.mark.parametrize("name", ["policy.safetensors", "policy.json"])
    @pytest.mark.parametrize("has_manifest", [True, False])
    def test_policy_that_is_gone_is_written_anew(self, lone, finished, tiny, name, has_manifest):
        (lone / name).unlink()
        if not has_manifest:
            (lone / "run.json").unlink()
        outcome = quietly(tiny(), lone, resume=True)
        assert (outcome.finished, outcome.was_complete) == (True, False)
        assert (lone / name).read_bytes() == (finished / "lone" / name).read_bytes()
        assert quietly(tiny(), lone, resume=True).was_complete

    def test_policy_of_a_group_that_is_gone_is_written_anew(self, group, finished, tiny):
        (group / "seed-4/policy.safetensors").unlink()
        assert quietly(tiny(), group, resume=True).finished
        for seed in (3, 4):
            path = f"seed-{seed}/policy.safetensors"
            assert (group / path).read_bytes() == (finished / "group" / path).read_bytes()

    @pytest.mark.parametrize("name", [*saving.NAMES, "run.json", "metrics.jsonl"])
    @pytest.mark.parametrize("make", [PIPE, os.mkdir], ids=["pipe", "folder"])
    def test_no_regular_file(self, lone, tiny, name, make):
        (lone / name).unlink()
        make(lone / name)
        with pytest.raises(InputError, match=f"{name}: cannot be read: it is no regular file"):
            quietly(tiny({"training.steps": 800}), lone, resume=True)

    def test_closed_file(self, lone, monkeypatch):
        def closed(path):
            raise PermissionError(13, "Permission denied", str(path))

        monkeypatch.setattr(Path, "read_bytes", closed)
        with pytest.raises(InputError, match="cannot be read: Permission denied"):
            RunFolder(lone).load_policy()


class TestWeights:
    """Of a policy without a checksum."""

    def change(self, folder, change):
        (folder / "run.json").unlink()
        path = folder / "policy.safetensors"
        weights = safetensors.torch.load_file(path)
        change(weights)
        safetensors.torch.save_file(weights, path)
        with pytest.raises(InputError) as raised:
            RunFolder(folder).load_policy()
        return str(raised.value)

    @pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
    def test_that_are_not_finite(self, lone, value):
        message = self.change(lone, lambda w: w["actor.0.bias"].view(-1).__setitem__(0, value))
        assert message.endswith("policy.safetensors: cannot be read: 'actor.0.bias' is not finite")

    @pytest.mark.parametrize("kind", [torch.float64, torch.float16, torch.int32])
    def test_of_another_type(self, lone, kind):
        message = self.change(
            lone, lambda w: w.update({"critic.0.bias": w["critic.0.bias"].to(kind)})
        )
        assert "'critic.0.bias' is a tensor of" in message

    def test_of_another_shape(self, lone):
        message = self.change(lone, lambda w: w.update({"critic.0.bias": torch.zeros(9)}))
        assert "'critic.0.bias' is a tensor of torch.float32, shape (9,), not of" in message

    def test_that_are_finite_and_lead_to_what_is_not(self, lone, tiny):
        (lone / "run.json").unlink()
        path = lone / "policy.safetensors"
        weights = safetensors.torch.load_file(path)
        for tensor in weights.values():
            tensor.fill_(3e38)
        safetensors.torch.save_file(weights, path)
        run, scenario = load_run(lone, tiny(), transfer=False)
        with pytest.raises(InputError, match="its weights lead to numbers that are not finite"):
            evaluate(scenario, run.load_policy(), 1)

    def test_too_few(self, lone):
        assert "lacks 'actor.0.bias'" in self.change(lone, lambda w: w.pop("actor.0.bias"))

    def test_too_many(self, lone):
        message = self.change(lone, lambda w: w.update(x=torch.zeros(1)))
        assert "has 'x', unknown here" in message


def test_policy_may_be_moved_out_of_its_group(group, tmp_path):
    shutil.move(group / "seed-3", tmp_path / "moved")
    assert RunFolder(tmp_path / "moved").load_policy()


def test_policies_of_a_group_go_on_alone_each(group, tiny):
    longer = tiny({"training.steps": 720})
    for seed in (3, 4):
        assert quietly(longer, group / f"seed-{seed}", resume=True).trainer.env_steps == 720
        assert RunFolder(group / f"seed-{seed}").policy_shape()["env_steps"] == 720
    with pytest.raises(InputError, match="continue with each by its own folder"):
        quietly(tiny({"training.steps": 800}), group, resume=True)


def test_weights_that_are_not_finite_are_not_saved(tiny, tmp_path, monkeypatch):
    iterate = Trainer.iterate_all

    def iterate_and_spoil(trainer):
        log = iterate(trainer)
        if trainer.env_steps == 480:
            trainer.network.actor[0].weight.data[0, 0] = float("nan")
        return log

    monkeypatch.setattr(Trainer, "iterate_all", iterate_and_spoil)
    with pytest.raises(InputError, match=r"diverged after 480 .*; last checkpoint: 240 steps"):
        quietly(tiny(), tmp_path / "run")
    monkeypatch.undo()
    assert quietly(tiny(), tmp_path / "run", resume=True).finished


class TestEarlierVersions:
    @pytest.fixture
    def kept(self, tmp_path):
        return shutil.copytree(FORMAT_2, tmp_path / "kept")

    @pytest.mark.parametrize("name", ["complete", "stopped", "replicas/seed-3", "replicas/seed-4"])
    def test_policy_is_evaluated(self, kept, tiny, name):
        before = contents(kept)
        run, scenario = load_run(kept / name, tiny(), transfer=False)
        evaluation = evaluate(scenario, run.load_policy(), 3)
        if name == "complete":
            expected = json.loads((kept / name / "result.json").read_text())["evaluation"]
            found = evaluation.metrics["mean_aoi"].mean
            assert found == pytest.approx(expected["metrics"]["mean_aoi"]["mean"])
        assert contents(kept) == before

    @pytest.mark.slow
    @pytest.mark.parametrize("name", ["stopped", "replicas", "replicas/seed-4"])
    def test_training_goes_on(self, kept, tiny, name):
        outcome = quietly(tiny(), kept / name, resume=True)
        assert outcome.finished
        for run in outcome.runs:
            assert (run.path / "run.json").is_file()
            assert run.policy_shape()["env_steps"] == 560
            assert len(run.metrics_path.read_text().splitlines()) == 7

    def test_complete_one_stays_as_it_is(self, kept, tiny):
        before = contents(kept / "complete")
        assert quietly(tiny(), kept / "complete", resume=True).finished
        after = contents(kept / "complete")
        assert {path: after[path] for path in before if path.name != "metrics.jsonl"} == {
            path: data for path, data in before.items() if path.name != "metrics.jsonl"
        }

    def test_versions_before_are_named(self, kept, tiny):
        shape = json.loads((kept / "stopped/policy.json").read_text())
        (kept / "stopped/policy.json").write_text(json.dumps({**shape, "format": 1}))
        with pytest.raises(
            InputError, match=r"another version .* format and world version \(1, 0\)"
        ):
            RunFolder(kept / "stopped").load_policy()


class TestPaths:
    def test_words_will_do(self, lone, tiny, tmp_path):
        assert RunFolder(str(lone)).load_policy()
        little = {"steps": 1, "environments": 2, "rollout_slots": 5, "minibatches": 1}
        mapping = {"extends": "paper/k3-tdd", "training": {**little, "hidden_units": [4]}}
        outcome = quietly(mapping, str(tmp_path / "run"))
        assert outcome.run.path == tmp_path / "run"
        assert Trainer("paper/k3-tdd").scenario.name == "paper/k3-tdd"

    @pytest.mark.parametrize("given", ["", "  ", None, 3, b"run", "a\0b", ["run"]])
    def test_no_paths(self, given, tiny):
        with pytest.raises(InputError, match="run folder: must be a path, not "):
            RunFolder(given)
        with pytest.raises(InputError, match="out: must be a path, not "):
            quietly(tiny(), given)

    def test_home(self, monkeypatch, tmp_path):
        monkeypatch.setenv("HOME", str(tmp_path))
        assert user_path("~/run", "--out") == tmp_path / "run"
        assert user_path("~nobody-of-that-name/run", "--out") == Path("~nobody-of-that-name/run")
