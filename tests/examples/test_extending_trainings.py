"""The examples of what is added to a training: a network, an optimizer, callbacks."""

import importlib.util
import json
import sys
import types
from pathlib import Path

import pytest

from iout_marl import evaluate
from trainers import RunFolder

pytestmark = pytest.mark.slow

EXTENDING = Path(__file__).parents[2] / "examples" / "extending"
#: Mean AoI in slots; on the paper's smallest scenario a random walk has 9, weights as drawn 20.
LEARNT = 6.5


@pytest.fixture
def example(forgotten_parts, monkeypatch):
    """The module of an example."""

    def load(name):
        spec = importlib.util.spec_from_file_location(f"example_{name}", EXTENDING / f"{name}.py")
        module = importlib.util.module_from_spec(spec)
        monkeypatch.setitem(sys.modules, spec.name, module)
        spec.loader.exec_module(module)
        return module

    return load


@pytest.mark.parametrize("name", ["network", "optimizer"])
def test_everything_named_learns(example, name, capsys):
    found = example(name).main(["--steps", "64000"])
    assert len(found) == {"network": 2, "optimizer": 3}[name]
    assert all(mean_aoi < LEARNT for mean_aoi in found.values()), found
    assert len(set(found.values())) == len(found)
    assert len(capsys.readouterr().out.splitlines()) == 1 + len(found)
    walk = evaluate("paper/k3-fdd", "random-walk", 20)
    assert walk.metrics["mean_aoi"].mean > LEARNT + 1


def test_early_stopping_ends_a_training_that_has_learnt(example, tmp_path, capsys):
    module = example("early_stopping")
    steps, mean_aoi = module.main(["--out", str(tmp_path / "run")])
    assert steps < 1_000_000
    assert mean_aoi < 5
    assert f"{steps:,} of 1,000,000 steps" in capsys.readouterr().out
    assert json.loads(RunFolder(tmp_path / "run").result())["env_steps"] == steps


class Wandb(types.ModuleType):
    """Keeps what Weights & Biases, which is no need of the tests, would be told."""

    def __init__(self):
        super().__init__("wandb")
        self.rows, self.summary, self.started, self.exit_code = [], {}, None, None

    def init(self, **settings):
        self.started = settings
        return self

    def log(self, figures, step):
        assert not self.rows or step > self.rows[-1][0], "steps must rise"
        self.rows.append((step, dict(figures)))

    def finish(self, exit_code):
        self.exit_code = exit_code


def test_log_to_wandb(example, tmp_path, monkeypatch):
    fake = Wandb()
    monkeypatch.setitem(sys.modules, "wandb", fake)
    out = tmp_path / "run"
    example("log_to_wandb").main(["--out", str(out), "--folder", str(tmp_path / "logs")])
    assert fake.started["mode"] == "offline"
    assert fake.started["config"]["training"]["steps"] == 100_000
    rows = [json.loads(row) for row in RunFolder(out).metrics_path.read_text().splitlines()]
    assert [step for step, _ in fake.rows] == [row["env_steps"] for row in rows]
    assert [f["ppo/loss"] for _, f in fake.rows] == [row["ppo/loss"] for row in rows]
    result = json.loads(RunFolder(out).result())
    assert fake.summary["final/mean_aoi"] == result["evaluation"]["metrics"]["mean_aoi"]["mean"]
    assert fake.exit_code == 0
