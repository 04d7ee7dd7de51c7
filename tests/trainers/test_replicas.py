"""Policies trained side by side are those that would be trained alone."""

import re
import shutil
from pathlib import Path

import pytest
import torch
from typer.testing import CliRunner

from iout_marl import InputError
from iout_marl.cli import app
from trainers import RunFolder, Trainer, train

TWO_AUVS = {"auvs.start_cells": [[2, 1, 1], [1, 2, 1]]}
VARIANTS = {
    "plain": {},
    "episodes across rollouts": {"training.rollout_slots": 13, "training.minibatches": 3},
    "masks, tdd, a layout for each": {
        "duplex.kind": "tdd",
        "training.mask_actions": True,
        "nodes": {"kind": "random", "count": 2, "redraw": "run"},
    },
    "running normalisers, random layouts": {
        "nodes": {"kind": "random", "count": 2},
        "training.observation_scaling": "running",
        "training.reward_scaling": "running",
        "reward.kind": "paper",
    },
    "two auvs, a critic that sees more, a network for nodes": {
        **TWO_AUVS,
        "training.critic": "central",
        "training.observation_scaling": "running",
        "training.node_network": True,
        "reward.credit": "difference",
        "training.activation": "relu",
    },
    "nothing scaled": {
        "training.observation_scaling": "none",
        "training.reward_scaling": "none",
        "training.normalise_value": False,
        "training.normalise_advantage": False,
    },
}


@pytest.fixture(params=VARIANTS.values(), ids=list(VARIANTS))
def scenario(request, tiny):
    return tiny(request.param)


def without_speed(log):
    return {tag: value for tag, value in log.items() if not tag.startswith("speed/")}


def assert_alike(first, second):
    assert set(first) == set(second)
    for name, tensor in first.items():
        torch.testing.assert_close(tensor, second[name], rtol=1e-4, atol=1e-5, msg=name)


@pytest.mark.slow
def test_each_is_what_it_would_be_alone(scenario):
    together = Trainer(scenario, seed=5, replicas=3)
    logs = [together.iterate_all() for _ in range(3)]
    for i in range(3):
        alone = Trainer(scenario, seed=5 + i)
        for log in logs:
            expected = without_speed(alone.iterate())
            assert without_speed(log[i]) == pytest.approx(expected, rel=1e-3, abs=1e-4)
        assert_alike(together.weights(i), alone.weights())
        assert together.scenarios[i] == alone.scenario
    assert not torch.equal(*(together.weights(i)["actor.0.weight"] for i in (0, 1)))


@pytest.mark.slow
def test_each_goes_on_from_its_state_together_or_alone(scenario):
    together = Trainer(scenario, seed=5, replicas=2)
    together.iterate_all()
    saved = [together.state_dict(i) for i in range(2)]
    again, alone = Trainer(scenario, seed=5, replicas=2), Trainer(scenario, seed=6)
    again.load_state_dict(*saved)
    alone.load_state_dict(saved[1])
    logs = together.iterate_all()
    assert [*map(without_speed, again.iterate_all())] == [*map(without_speed, logs)]
    expected = pytest.approx(without_speed(logs[1]), rel=1e-3, abs=1e-4)
    assert without_speed(alone.iterate()) == expected


def test_speed_counts_the_steps_of_all(tiny):
    trainer = Trainer(tiny(), replicas=4)
    first, *others = trainer.iterate_all()
    assert trainer.env_steps == trainer.steps_per_iteration == 80
    assert all(o["speed/env_steps_per_s"] == first["speed/env_steps_per_s"] for o in others)
    shares = [first[f"speed/{part}_share"] for part in ("rollout", "learn")]
    assert sum(shares) == pytest.approx(1)
    parts = [first[f"speed/{part}_share"] for part in ("environment", "inference")]
    assert min(parts) > 0
    assert sum(parts) < shares[0]


def test_epochs_that_stop_early_are_refused(tiny):
    with pytest.raises(InputError, match=r"training\.target_kl: policies trained side by side"):
        Trainer(tiny({"training.target_kl": 0.01}), replicas=2)


def test_a_state_of_another_layout_is_refused(tiny):
    nodes = {"kind": "random", "count": 2, "redraw": "run"}
    saved = Trainer(tiny({"nodes": nodes}), seed=2).state_dict()
    with pytest.raises(InputError, match=r"^seed: .* layout of seed 0, .* of seed 2: train"):
        Trainer(tiny({"nodes": nodes})).load_state_dict(saved)
    Trainer(tiny()).load_state_dict(Trainer(tiny(), seed=7).state_dict())


class TestRuns:
    """A folder for each policy, as good as that of a lone run."""

    @pytest.fixture
    def short(self, tiny):
        nodes = {"kind": "random", "count": 2, "redraw": "run"}
        return tiny({"training.steps": 240, "nodes": nodes})

    @pytest.mark.slow
    def test_folders(self, short, tmp_path):
        outcome = train(short, tmp_path, seed=7, replicas=2, evaluation_episodes=2)
        assert [run.path.name for run in outcome.runs] == ["seed-7", "seed-8"]
        for seed, run, evaluation in zip((7, 8), outcome.runs, outcome.evaluations, strict=True):
            alone = train(short, tmp_path / f"{seed}", seed=seed, evaluation_episodes=2)
            assert run.scenario() == alone.run.scenario()
            names, expected = (
                {path.name.split(".")[0] for path in folder.iterdir() if path.name != ".lock"}
                for folder in (run.path, alone.run.path)
            )
            assert names == expected
            assert_alike(
                run.load_policy().network.state_dict(),
                alone.run.load_policy().network.state_dict(),
            )
            assert evaluation.metrics["mean_aoi"].mean == pytest.approx(
                alone.evaluation.metrics["mean_aoi"].mean, rel=1e-3
            )

    @pytest.mark.slow
    def test_go_on_together(self, short, tmp_path):
        options = {"evaluation_episodes": 1}
        longer = short.model_copy(
            update={"training": short.training.model_copy(update={"steps": 480})}
        )
        train(short, tmp_path / "parts", seed=1, replicas=2, **options)
        parts = train(longer, tmp_path / "parts", resume=True, **options)
        assert len(parts.runs) == 2
        for run, steps in zip(parts.runs, (480, 480), strict=True):
            lines = run.metrics_path.read_text().splitlines()
            assert len(lines) == steps // 80

    @pytest.mark.slow
    def test_that_have_not_come_equally_far(self, short, tmp_path):
        train(short, tmp_path, replicas=2, evaluation_episodes=1)
        longer = short.model_copy(
            update={"training": short.training.model_copy(update={"steps": 480})}
        )
        train(longer, tmp_path / "seed-1", resume=True, evaluation_episodes=1)
        with pytest.raises(InputError, match="have not come equally far"):
            train(longer, tmp_path, resume=True, evaluation_episodes=1)

    def test_that_are_not_all_there(self, short, tmp_path):
        train(short, tmp_path, replicas=3, evaluation_episodes=1)
        shutil.rmtree(tmp_path / "seed-2")
        with pytest.raises(InputError, match=r"seed-2/run\.json: is missing"):
            train(short, tmp_path, resume=True, evaluation_episodes=1)

    def test_copies_beside_them_do_not_matter(self, short, tmp_path):
        train(short, tmp_path, replicas=2, evaluation_episodes=1)
        shutil.copytree(tmp_path / "seed-1", tmp_path / "seed-1-copy")
        assert len(train(short, tmp_path, resume=True, evaluation_episodes=1).runs) == 2

    @pytest.mark.slow
    @pytest.mark.parametrize(
        ("first", "second"),
        [
            ({"replicas": 2, "seed": 5}, {"replicas": 2, "seed": 4}),
            ({"replicas": 2, "seed": 5}, {"replicas": 2, "seed": 7}),
            ({"replicas": 2}, {}),
            ({}, {"replicas": 2}),
        ],
        ids=["overlapping", "beside", "lone after several", "several after a lone one"],
    )
    def test_folder_in_use_is_left_as_it_was(self, short, tmp_path, first, second):
        train(short, tmp_path, evaluation_episodes=1, **first)

        def files():
            there = (path for path in tmp_path.rglob("*") if path.is_file())
            return {path: path.stat().st_mtime_ns for path in there if path.name != ".lock"}

        before = files()
        with pytest.raises(InputError, match="holds a run already"):
            train(short, tmp_path, evaluation_episodes=1, **second)
        assert files() == before
        assert train(short, tmp_path, resume=True, evaluation_episodes=1).finished

    @pytest.mark.slow
    def test_are_saved_together_or_not_at_all(self, short, tmp_path, monkeypatch):
        train(short, tmp_path, replicas=2, evaluation_episodes=1)
        longer = short.model_copy(
            update={"training": short.training.model_copy(update={"steps": 480})}
        )
        whole, opened = Path.open, []

        def failing(path, mode="r", *args, **kwargs):
            if path.name == "policy.json.part" and path.parent.name == "seed-1":
                opened.append(path)
                raise OSError(28, "No space left on device")
            return whole(path, mode, *args, **kwargs)

        monkeypatch.setattr(Path, "open", failing)
        with pytest.raises(InputError, match="No space left"):
            train(longer, tmp_path, resume=True, evaluation_episodes=1)
        monkeypatch.undo()
        assert opened
        outcome = train(longer, tmp_path, resume=True, evaluation_episodes=1)
        assert outcome.trainer.env_steps == 480

    @pytest.mark.slow
    def test_many_are_told_of_by_their_spread(self, tmp_path):
        arguments = ["--steps", "200", "--replicas", "6", "--out", str(tmp_path)]
        arguments += ["--set", "training.environments=2", "--set", "training.rollout_slots=100"]
        output = CliRunner().invoke(app, ["train", "paper/k3-tdd", *arguments]).output
        assert "6 policies" in output
        (row,) = (line for line in output.splitlines() if "│ mean AoI" in line)
        low, median, high = (float(word) for word in re.findall(r"\d+\.\d+", row))
        assert low <= median <= high

    def test_command_line(self, tmp_path):
        arguments = ["--steps", "200", "--replicas", "2", "--out", str(tmp_path), "--seed", "3"]
        arguments += ["--set", "training.environments=2", "--set", "training.rollout_slots=100"]
        result = CliRunner().invoke(app, ["train", "paper/k3-tdd", *arguments])
        assert result.exit_code == 0, result.output
        for seed in (3, 4):
            assert RunFolder(tmp_path / f"seed-{seed}").load_policy()
            assert f"seed-{seed}" in result.output
