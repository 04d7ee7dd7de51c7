"""The run folder: what lies in it, and what is refused when it is read."""

import io
import json
import os
import pickle
import shutil

import numpy as np
import pytest
import safetensors.torch
import torch
from rich.console import Console
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from iout_marl import InputError, evaluate, load_scenario
from trainers import RunFolder, Trainer, find_device, train
from trainers.runs.loading import load_run
from trainers.runs.saving import NAMES

#: What of a save shows that something was learnt.
RESULTS = [*NAMES[1:], "run.json"]
#: Of design.md; `reward/…` are the terms of the scenario's reward.
TAGS = {
    "aoi/mean", "aoi/final", "aoi/peak", "fairness/jain", "energy/harvested_kj",
    "energy/spent_kj", "uplink/success_rate", "reward/total",
    "ppo/loss", "ppo/policy_loss", "ppo/value_loss", "ppo/kl", "ppo/clip_fraction",
    "ppo/entropy", "ppo/explained_variance", "ppo/learning_rate",
    "speed/env_steps_per_s", "speed/rollout_share", "speed/learn_share",
    "speed/environment_share", "speed/inference_share", "speed/logging_share",
}  # fmt: skip
FILES = {
    "scenario.yaml", "policy.safetensors", "policy.json", "checkpoint.pt", "metrics.jsonl",
    "result.json", "run.json", ".lock",
}  # fmt: skip


def quietly(scenario, folder, **options):
    return train(
        scenario, folder, console=Console(file=io.StringIO()), evaluation_episodes=3, **options
    )


@pytest.fixture(scope="module")
def finished(tiny, tmp_path_factory):
    folder = tmp_path_factory.mktemp("finished") / "run"
    return quietly(tiny(), folder, seed=7)


@pytest.fixture
def folder(finished, tmp_path):
    """A copy of a finished run, to be damaged; without checksums, which would see any damage."""
    shutil.copytree(finished.run.path, tmp_path / "run")
    (tmp_path / "run/run.json").unlink()
    return tmp_path / "run"


def refusal(action):
    with pytest.raises(InputError) as raised:
        action()
    assert str(raised.value).isprintable(), "not one line"
    return str(raised.value)


def resumed(scenario, folder):
    return refusal(lambda: quietly(scenario, folder, resume=True))


class TestContents:
    def test_files_of_the_contract(self, finished):
        names = {p.name for p in finished.run.path.iterdir()}
        events = {name for name in names if name.startswith("events.out.tfevents.")}
        assert names - events == FILES
        assert len(events) == 1

    def test_scenario_is_the_resolved_one(self, finished, tiny):
        assert finished.run.scenario() == tiny()
        assert "extends" not in (finished.run.path / "scenario.yaml").read_text()

    def test_policy_and_its_shape(self, finished):
        shape = json.loads((finished.run.path / "policy.json").read_text())
        assert shape["scenario_hash"] == finished.trainer.scenario.hash
        assert shape["env_steps"] == 560
        assert shape["action_sizes"] == [6, 2, 2]
        assert shape["observation_entries"] == 3 + 2 + 2
        assert shape["hidden_units"] == [8]
        assert shape["network"] == "mlp"
        weights = safetensors.torch.load_file(finished.run.path / "policy.safetensors")
        for name, tensor in finished.trainer.weights().items():
            assert torch.equal(weights[name], tensor)

    def test_checkpoint_holds_plain_data_alone(self, finished):
        saved = torch.load(finished.run.checkpoint_path, weights_only=True)
        assert saved["world_hash"] == finished.trainer.scenario.world_hash
        assert saved["trainer"]["env_steps"] == 560

    def test_metrics_have_a_line_for_every_iteration(self, finished):
        lines = [json.loads(line) for line in finished.run.metrics_path.read_text().splitlines()]
        assert [line["env_steps"] for line in lines] == list(range(80, 561, 80))
        assert all(set(line) >= TAGS for line in lines)
        assert all(np.isfinite(list(line.values())).all() for line in lines)

    def test_tensorboard_has_the_tags_of_the_contract_and_the_same_figures(self, finished):
        events = EventAccumulator(str(finished.run.path))
        events.Reload()
        assert set(events.Tags()["scalars"]) >= TAGS
        for line in map(json.loads, finished.run.metrics_path.read_text().splitlines()):
            for tag, value in line.items():
                if tag != "env_steps":
                    shown = {e.step: e.value for e in events.Scalars(tag)}
                    assert shown[line["env_steps"]] == pytest.approx(value, rel=1e-5, abs=1e-6)

    def test_terms_of_the_papers_reward_have_tags(self, tiny, tmp_path):
        trainer = Trainer(tiny({"reward.kind": "paper"}))
        terms = {tag for tag in trainer.iterate() if tag.startswith("reward/")}
        world = trainer.collector.world
        state, events = world.step(trainer.collector.state, np.zeros((4, 1, 3), dtype=int))
        expected = {f"reward/{name}" for name in world.reward_terms(state, events)}
        assert terms == expected | {"reward/total"}
        assert len(terms) > 2

    def test_result_is_the_final_policys_evaluation(self, finished):
        result = json.loads((finished.run.path / "result.json").read_text())
        assert (result["seed"], result["env_steps"], result["device"]) == (7, 560, "cpu")
        assert result["seconds"] > 0
        assert result["evaluation"] == finished.evaluation.to_json()
        again = evaluate(finished.run.scenario(), finished.run.load_policy(), 3, seed=0)
        assert again.to_json() == result["evaluation"]

    def test_nothing_is_left_half_written(self, finished):
        assert not list(finished.run.path.glob("*.part"))

    def test_same_seed_writes_the_same_bytes(self, finished, tiny, tmp_path):
        quietly(tiny(), tmp_path / "run", seed=7)
        for name in ("policy.safetensors", "policy.json", "scenario.yaml"):
            assert (tmp_path / "run" / name).read_bytes() == (finished.run.path / name).read_bytes()


class TestCreating:
    def test_existing_run_is_not_overwritten(self, folder, tiny):
        before = {p.name: p.read_bytes() for p in folder.iterdir()}
        message = refusal(lambda: quietly(tiny(), folder))
        assert "holds a run already; continue with it by --resume" in message
        assert {p.name: p.read_bytes() for p in folder.iterdir()} == before

    @pytest.mark.parametrize("kept", RESULTS)
    def test_nothing_that_was_learnt_is_replaced(self, folder, tiny, finished, kept):
        if kept == "run.json":
            shutil.copy(finished.run.path / kept, folder)
        for name in set(RESULTS) - {kept}:
            (folder / name).unlink(missing_ok=True)
        assert "holds a run already" in refusal(lambda: quietly(tiny(), folder, seed=7))

    def test_folders_above_are_made(self, tiny, tmp_path):
        quietly(tiny({"training.steps": 80}), tmp_path / "a/b/c")
        assert (tmp_path / "a/b/c/result.json").is_file()

    @pytest.mark.parametrize("name", ["file", "file/run", "x" * 300])
    def test_folder_that_cannot_be_made(self, tiny, tmp_path, name):
        (tmp_path / "file").touch()
        assert "cannot be " in refusal(lambda: quietly(tiny(), tmp_path / name))

    @pytest.mark.parametrize("name", ["scenario.yaml", "metrics.jsonl", "checkpoint.pt.part"])
    def test_folder_in_the_way_of_a_file(self, tiny, tmp_path, name):
        (tmp_path / "run" / name / "inside").mkdir(parents=True)
        message = refusal(lambda: quietly(tiny(), tmp_path / "run"))
        assert "cannot be" in message

    def test_too_little_memory_on_the_device(self, tiny, tmp_path, monkeypatch):
        def too_much(_):
            raise torch.OutOfMemoryError("CUDA out of memory.\nTried to allocate 1 TiB")

        monkeypatch.setattr(Trainer, "iterate_all", too_much)
        message = refusal(lambda: quietly(tiny(), tmp_path / "run"))
        assert "run: not enough memory: smaller training.hidden_units, fewer" in message


class TestResuming:
    def test_no_run(self, tiny, tmp_path):
        assert "holds no run: there is no scenario.yaml in it" in resumed(tiny(), tmp_path / "no")

    def test_run_without_a_checkpoint(self, folder, tiny):
        (folder / "checkpoint.pt").unlink()
        assert resumed(tiny(), folder).endswith("run: holds no checkpoint")

    @pytest.mark.parametrize("kept", [0, 1, 100, 5000, -1, -500])
    def test_truncated_checkpoint(self, folder, tiny, kept):
        data = (folder / "checkpoint.pt").read_bytes()
        (folder / "checkpoint.pt").write_bytes(data[:kept])
        message = resumed(tiny(), folder)
        assert "checkpoint.pt: cannot be read" in message or "checkpoint.pt: refused" in message

    @pytest.mark.parametrize("seed", range(8))
    def test_garbled_checkpoint(self, folder, tiny, seed):
        rng = np.random.default_rng(seed)
        data = bytearray((folder / "checkpoint.pt").read_bytes())
        start = rng.integers(0, len(data) - 600)
        data[start : start + 600] = rng.bytes(600)
        (folder / "checkpoint.pt").write_bytes(data)
        try:
            quietly(tiny(), folder, resume=True)
        except InputError as error:
            assert str(error).isprintable()  # noqa: PT017 (damage to padding goes unnoticed)

    @pytest.mark.parametrize("data", [b"", b"hello", b"\0" * 1000, pickle.dumps({"format": 1})])
    def test_something_else_in_place_of_a_checkpoint(self, folder, tiny, data):
        (folder / "checkpoint.pt").write_bytes(data)
        assert "checkpoint.pt: " in resumed(tiny(), folder)

    def test_pickled_object_is_refused_and_not_run(self, folder, tiny):
        class Trap:
            def __reduce__(self):
                return os.mkdir, (str(folder / "sprung"),)

        torch.save({"format": 1, "world_version": 0, "trap": Trap()}, folder / "checkpoint.pt")
        message = resumed(tiny(), folder)
        assert "checkpoint.pt: refused: damaged, or it holds Python objects" in message
        assert not (folder / "sprung").exists()

    @pytest.mark.slow
    @pytest.mark.parametrize(
        ("changes", "expected"),
        [
            ({"format": 0}, "is of another version of this software"),
            ({"format": None}, "is of another version of this software"),
            ({"world_version": 99}, "is of another version of this software"),
            ({"trainer": {}}, "cannot be read"),
            ({"trainer": 3}, "cannot be read"),
            ({"trainer": {"collector": {"generator": 3}}}, "cannot be read"),
        ],
    )
    def test_checkpoint_of_another_making(self, folder, tiny, changes, expected):
        saved = torch.load(folder / "checkpoint.pt", weights_only=True)
        torch.save(saved | changes, folder / "checkpoint.pt")
        assert expected in resumed(tiny(), folder)

    @pytest.mark.parametrize("key", ["network", "optimizer", "reward_scale", "seed", "env_steps"])
    def test_checkpoint_that_lacks_something(self, folder, tiny, key):
        saved = torch.load(folder / "checkpoint.pt", weights_only=True)
        del saved["trainer"][key]
        torch.save(saved, folder / "checkpoint.pt")
        assert f"checkpoint.pt: cannot be read: lacks '{key}'" in resumed(tiny(), folder)

    def test_checkpoint_of_other_networks(self, folder, tiny, tmp_path):
        quietly(tiny({"training.hidden_units": [9]}), tmp_path / "other")
        shutil.copy(tmp_path / "other/checkpoint.pt", folder)
        assert "checkpoint.pt: cannot be read: " in resumed(tiny(), folder)

    def test_list_in_place_of_a_checkpoint(self, folder, tiny):
        torch.save([1, 2], folder / "checkpoint.pt")
        assert "is of another version" in resumed(tiny(), folder)


class TestLoadingAPolicy:
    def load(self, folder):
        return refusal(RunFolder(folder).load_policy)

    @pytest.mark.parametrize("name", ["policy.safetensors", "policy.json"])
    def test_missing_file(self, folder, name):
        (folder / name).unlink()
        assert self.load(folder).endswith("run: holds no trained policy")

    @pytest.mark.parametrize("data", [b"", b"{", b"\xff\xff", b"[" * 100_000])
    def test_shape_that_is_no_json(self, folder, data):
        (folder / "policy.json").write_bytes(data)
        assert "policy.json: cannot be read: " in self.load(folder)

    @pytest.mark.parametrize(
        ("changes", "expected"),
        [
            ({"format": 0}, "policy.json: is of another version of this software"),
            ({"world_version": 99}, "policy.json: is of another version of this software"),
            ({"world_hash": "0" * 12}, "its policy is of another scenario than scenario.yaml"),
        ],
    )
    def test_policy_of_another_making(self, folder, changes, expected):
        shape = json.loads((folder / "policy.json").read_text())
        (folder / "policy.json").write_text(json.dumps(shape | changes))
        assert expected in self.load(folder)

    @pytest.mark.parametrize("text", ["[]", "3", "null", '{"format": 1}'])
    def test_shape_that_is_no_mapping(self, folder, text):
        (folder / "policy.json").write_text(text)
        assert "is of another version" in self.load(folder)

    @pytest.mark.parametrize("key", ["world_hash", "source_world_hash", "mask_actions"])
    def test_shape_that_lacks_something(self, folder, key):
        shape = json.loads((folder / "policy.json").read_text())
        del shape[key]
        (folder / "policy.json").write_text(json.dumps(shape))
        assert f"policy.json: cannot be read: lacks '{key}'" in self.load(folder)

    @pytest.mark.parametrize("kept", [0, 7, 100, -1])
    def test_truncated_weights(self, folder, kept):
        data = (folder / "policy.safetensors").read_bytes()
        (folder / "policy.safetensors").write_bytes(data[:kept])
        assert "policy.safetensors: cannot be read: " in self.load(folder)

    def test_weights_of_other_networks(self, folder, tiny, tmp_path):
        quietly(tiny({"training.hidden_units": [9]}), tmp_path / "other")
        shutil.copy(tmp_path / "other/policy.safetensors", folder)
        assert "policy.safetensors: cannot be read: " in self.load(folder)

    def test_scenario_that_is_broken(self, folder):
        (folder / "scenario.yaml").write_text("a: [")
        assert "scenario.yaml:1: broken YAML" in self.load(folder)


class TestEvaluatingARun:
    def test_same_world_with_another_reward_is_fine(self, folder, tiny):
        run, scenario = load_run(folder, tiny({"reward.kind": "paper"}), transfer=False)
        assert scenario.reward.kind == "paper"
        assert evaluate(scenario, run.load_policy(), 1).scenario_hash == scenario.hash

    @pytest.mark.parametrize(
        ("changes", "key"),
        [
            ({"age.maximum": 14}, "age.maximum"),
            ({"channel.noise_level_db": 31}, "channel.noise"),
            # Entries that one AUV does not have, and masks, which are no part of what it sees.
            ({"observation.other_auvs": False}, "observation.other_auvs"),
            ({"observation.action_mask": "info"}, "observation.action_mask"),
        ],
    )
    def test_other_world_needs_transfer(self, folder, tiny, changes, key):
        message = refusal(lambda: load_run(folder, tiny(changes), transfer=False))
        assert f"was trained on another scenario, best/k3-fdd, whose {key}" in message
        assert message.endswith("--transfer evaluates it all the same")
        run, scenario = load_run(folder, tiny(changes), transfer=True)
        assert scenario == tiny(changes)
        assert evaluate(scenario, run.load_policy(), 1).episodes == 1

    @pytest.mark.parametrize(
        ("changes", "needs"),
        [
            ({"nodes": {"cells": [[1, 1, 1]], "count": 1}}, "nodes.count 2, not 1"),
            ({"duplex.kind": "tdd"}, "duplex.kind fdd, not tdd"),
            ({"observation.time": True}, "observation.time False, not True"),
            (
                {"channel.access": "exclusive", "observation.view_range_m": 100},
                "observation.view_range_m null, not a range",
            ),
            ({"auvs.start_cells": [[1, 1, 1], [2, 1, 1]]}, "auvs.count 1, not 2"),
            (
                {"auvs": {"count": 2, "motion": "hover"}},
                "auvs.count 1, not 2; auvs.motion six, not hover",
            ),
            ({"auvs.idle_choices": True}, "auvs.idle_choices False, not True"),
        ],
    )
    def test_world_that_does_not_fit_is_refused_in_any_case(self, folder, tiny, changes, needs):
        for transfer in (False, True):
            message = refusal(lambda t=transfer: load_run(folder, tiny(changes), transfer=t))
            assert f"its observations and actions do not fit; it needs {needs}" in message

    def test_run_in_a_layout_of_its_own_is_evaluated_there(self, tiny, tmp_path):
        drawn = tiny({"nodes": {"kind": "random", "count": 2, "redraw": "run"}})
        outcome = quietly(drawn, tmp_path / "run", seed=5)
        run, scenario = load_run(tmp_path / "run", drawn, transfer=False)
        assert scenario.nodes == outcome.trainer.scenario.nodes
        found = evaluate(scenario, run.load_policy(), 3, seed=0)
        assert found.to_json()["metrics"] == outcome.evaluation.to_json()["metrics"]

    def test_no_run(self, tiny, tmp_path):
        message = refusal(lambda: load_run(tmp_path, tiny(), transfer=False))
        assert message.endswith("holds no trained policy")

    def test_policy_can_be_evaluated_from_elsewhere(self, folder, tiny, monkeypatch):
        # A preset of one's own must not be needed any more.
        text = (folder / "scenario.yaml").read_text()
        (folder / "scenario.yaml").write_text(text.replace("preset: fast", "preset: own.yaml"))
        monkeypatch.chdir("/")
        assert RunFolder(folder).load_policy().network.action_sizes == (6, 2, 2)


@pytest.mark.parametrize("name", ["cpu", "auto"])
def test_device_is_found(name):
    assert find_device(name).type in ("cpu", "cuda")


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("gpu", "--device gpu: unknown device (known: auto, cpu, cuda)"),
        ("", "--device : unknown device (known: auto, cpu, cuda)"),
        ("meta", "--device meta: unknown device (known: auto, cpu, cuda)"),
        ("cuda:99", "--device cuda:99: this machine has no such device"),
        ("cuda:x", "--device cuda:x: unknown device"),
    ],
)
def test_device_that_is_not_there(name, expected):
    assert expected in refusal(lambda: find_device(name))


def test_missing_cuda_device(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert refusal(lambda: find_device("cuda")).endswith("this machine has no such device")
    assert find_device("auto").type == "cpu"


def test_bundled_scenario_builds_a_trainer():
    assert Trainer(load_scenario("paper/k3-tdd"), 0).network.action_sizes == (6, 3)
