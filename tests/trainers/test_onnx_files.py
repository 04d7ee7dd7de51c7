"""A policy in ONNX finds what it finds in torch, for whatever it sees and is made of."""

import os
import runpy
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import onnxruntime
import pytest
import torch
from batteries import BATTERY
from torch import nn

from iout_marl import InputError, World, evaluate, load_scenario, parts
from iout_marl.outside import bring_in
from iout_marl.registry import registry_of
from trainers import RunFolder
from trainers.factory import make_network
from trainers.onnx_file import onnx_file
from trainers.trained import TrainedPolicy

pytestmark = pytest.mark.slow

EXAMPLES = Path(__file__).parents[2] / "examples"
SHORT = {"episode.duration_s": 250}
#: Between them all kinds of observations with all that may be in them, and all that networks are
#: made of.
CASES = {
    "paper": ("paper/k3-fdd", {}),
    "everything-seen": (
        "multi/m3-k10-fdd",
        {
            "auvs.idle_choices": True,
            "observation.kind": "scaled",
            "observation.node_positions": True,
            "observation.time": True,
            "observation.view_range_m": 400,
            "observation.agent_index": True,
            "observation.entries": [
                *("time", "transit", "harvests", "battery", "batteries", "current"),
            ],
            "vehicle": {**BATTERY, "max_speed_m_per_s": 5.0},
            "current": {"kind": "tide", "speed_m_per_s": 0.5, "toward_deg": 30.0},
            "episode.slot_s": 10,
            "training.activation": "relu",
            "training.observation_scaling": "running",
            "training.node_network": True,
            "training.critic": "central",
        },
    ),
    "table": (
        "multi/m2-k10-fdd",
        {
            "observation": {"kind": "table", "view_range_m": 400},
            "training.network": {
                "kind": "set",
                "blocks": 1,
                "width": 8,
                "heads": 2,
                "critic_width": 8,
            },
        },
    ),
    "tdd-as-it-is": (
        "best/k3-tdd",
        {
            "auvs.motion": "hover",
            "training.hidden_units": [8],
            "training.node_network": True,
            "training.observation_scaling": "none",
        },
    ),
}
OUTSIDE = ("paper/k3-fdd", {"training.network": "node_attention"})


def made(name, changes):
    """A scenario, and a policy far from uniform, as if it had been trained."""
    scenario = load_scenario(name, {**SHORT, **changes})
    world = World(scenario)
    torch.manual_seed(0)
    network = make_network(world.observer, world.action_sizes, scenario.training).eval()
    with torch.no_grad():
        for weights in network.parameters():
            weights.add_(0.3 * torch.randn(weights.shape))
        if network.scaler.running:
            network.scaler.shift.normal_()
            network.scaler.scale.uniform_(5, 50)
    return scenario, TrainedPolicy(network, use_mask=scenario.training.mask_actions)


@cache
def written(case):
    """The file of a case."""
    scenario, policy = made(*CASES[case])
    return onnx_file(policy, scenario)


def session_of(contents):
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    return onnxruntime.InferenceSession(contents, options)


def assert_agrees(scenario, policy, contents):
    session, world = session_of(contents), World(scenario, 7)
    state = world.reset(seed=1)
    rng = np.random.default_rng(0)
    network, layout = policy.network, world.observer.layout
    if layout is not None:
        network = network.sized_for(layout, world.action_sizes)
    for _ in range(world.num_slots):
        shape = (7, world.num_auvs)
        action = np.stack([rng.integers(n, size=shape) for n in world.action_sizes], axis=-1)
        state, _ = world.step(state, action)
        seen = world.observe(state).reshape(7 * world.num_auvs, -1).astype(np.float32)
        masks = world.action_mask(state).reshape(len(seen), -1)
        for count in (1, len(seen)):
            for mask in (masks[:count], None):
                given = {"observation": seen[:count]} | ({} if mask is None else {"mask": mask})
                if layout is not None:
                    allowed = np.ones((count, masks.shape[1]), bool) if mask is None else mask
                    given = {**layout.rows(seen[:count]), "action_mask": allowed}
                action, logits = session.run(["action", "logits"], given)
                with torch.no_grad():
                    inputs = network.scaler(torch.from_numpy(seen[:count]))
                    expected = network.logits(
                        inputs, None if mask is None else torch.from_numpy(mask)
                    )
                assert logits.shape == (count, sum(world.action_sizes))
                flat = torch.cat(
                    [expected[:, i, :n] for i, n in enumerate(world.action_sizes)], dim=-1
                )
                assert logits == pytest.approx(flat.numpy(), rel=1e-5, abs=1e-5)
                # The best, up to what rounding may decide.
                taken = expected.gather(-1, torch.from_numpy(action)[..., None])[..., 0]
                best = expected.max(-1).values
                assert (best - taken <= 2e-5 * best.abs().clamp_min(1)).all()


@pytest.mark.parametrize("case", [case for case in CASES if case != "table"])
def test_onnxruntime_finds_what_torch_does(case):
    scenario, policy = made(*CASES[case])
    assert_agrees(scenario, policy, written(case))


def test_a_set_network_is_written_for_any_number_of_nodes_and_of_other_auvs():
    scenario, policy = made(*CASES["table"])
    contents = written("table")
    assert_agrees(scenario, policy, contents)
    for nodes, auvs in ((1, 2), (2, 3), (20, 5)):
        others = {"nodes": {"kind": "random", "count": nodes}, "auvs.count": auvs}
        assert_agrees(load_scenario(scenario, others), policy, contents)


def test_a_network_from_outside_is_written_too(forgotten_parts):
    bring_in(str(EXAMPLES / "extending" / "network.py"))
    scenario, policy = made(*OUTSIDE)
    assert_agrees(scenario, policy, onnx_file(policy, scenario))


def test_the_cases_are_all_there_are():
    scenarios = [load_scenario(name, changes) for name, changes in CASES.values()]
    kinds = {scenario.observation.kind for scenario in scenarios}
    assert kinds == set(registry_of("observation").kinds)
    seen = {entry.kind for scenario in scenarios for entry in scenario.seen}
    assert seen == set(registry_of("observation entry").kinds)
    trainings = [scenario.training for scenario in scenarios]
    assert {t.network.kind for t in trainings} == set(registry_of("network").kinds)
    assert {t.observation_scaling for t in trainings} == {"none", "fixed", "running"}
    assert {t.activation for t in trainings} == {"tanh", "relu"}
    assert {t.node_network for t in trainings} == {True, False}
    assert {t.mask_actions for t in trainings} == {True, False}


class Undecided(nn.Module):
    """Does what no graph can: it looks at the numbers."""

    def __init__(self, outputs):
        super().__init__()
        self.layer = nn.LazyLinear(outputs)

    def forward(self, inputs):
        found = self.layer(inputs)
        return found if float(found.detach().sum()) > 0 else -found


def test_a_network_that_no_graph_can_be_made_of_is_refused_in_a_line(forgotten_parts):
    @parts.networks.register("undecided", version=1)
    class UndecidedNetwork(parts.Network):
        def make_actor(self, sizes):
            return Undecided(sizes.choices)

        def make_critic(self, sizes):
            return nn.Linear(sizes.critic_entries, 1)

    scenario, policy = made("paper/k3-fdd", {"training.network": "undecided"})
    with pytest.raises(InputError, match=r"^ppo: cannot be written in ONNX: .+") as raised:
        onnx_file(policy, scenario)
    assert str(raised.value).isprintable()


def test_what_onnxruntime_finds_is_compared(monkeypatch):
    from trainers import onnx_file as module

    scenario, policy = made(*CASES["paper"])
    contents = written("paper")
    monkeypatch.setattr(module, "_written", lambda *_: contents)
    assert onnx_file(policy, scenario) == contents
    with torch.no_grad():
        policy.network.actor[-1].bias += 0.001
    with pytest.raises(InputError, match=r"logits that differ from those of torch by \d"):
        onnx_file(policy, scenario)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run that was trained with masks."""
    from tiny_study import TINY

    from trainers import train

    folder = tmp_path_factory.mktemp("onnx") / "run"
    changes = {**TINY, "training.steps": 80, "training.mask_actions": True}
    train(load_scenario("best/k3-fdd", changes), folder)
    return folder


@pytest.fixture(scope="module")
def exported(run):
    from iout_marl.cli import main

    target = run.parent / "mine.onnx"
    with pytest.raises(SystemExit) as ended:
        main(["export", str(run), "--onnx", str(target)])
    assert not ended.value.code
    return target


def test_the_file_says_what_it_is_of(run, exported):
    session = session_of(exported.read_bytes())
    scenario = RunFolder(run).scenario()
    assert session.get_modelmeta().custom_metadata_map == {
        "software": "iout_marl",
        "scenario": "best/k3-fdd",
        "scenario_hash": scenario.hash,
        "action_sizes": "[6,2,2]",
        "trained_with_mask": "true",
    }
    assert [(each.name, each.type) for each in session.get_inputs()] == [
        ("observation", "tensor(float)")
    ]
    assert [each.name for each in session.get_overridable_initializers()] == ["mask"]
    outputs = [(each.name, each.type) for each in session.get_outputs()]
    assert outputs == [("action", "tensor(int64)"), ("logits", "tensor(float)")]


def test_the_pretrained_policy_is_written_for_a_scenario_and_plays_in_others(
    iout, capsys, monkeypatch, tmp_path
):
    target = tmp_path / "any.onnx"
    status, _, told = iout("export", "pretrained", "--scenario", "best/k3-tdd", "--onnx", target)
    assert status == 0, told
    monkeypatch.setattr(sys, "argv", ["", str(target), "random/k5-tdd"])
    runpy.run_path(str(EXAMPLES / "onnx_policy.py"), run_name="__main__")
    printed = capsys.readouterr()
    assert printed.err == ""
    expected = evaluate("random/k5-tdd", "pretrained", 1).metrics["mean_aoi"].mean
    assert float(printed.out) == pytest.approx(expected)


def test_the_example_plays_without_torch(run, exported):
    program = f"""
import runpy, sys
class WithoutTorch:
    def find_spec(self, name, *_):
        if name.partition(".")[0] == "torch":
            raise ImportError(name)
sys.meta_path.insert(0, WithoutTorch())
sys.argv = ["", {str(exported)!r}, {str(run / "scenario.yaml")!r}]
runpy.run_path({str(EXAMPLES / "onnx_policy.py")!r})
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    scenario = RunFolder(run).scenario()
    expected = evaluate(scenario, str(run)).metrics["mean_aoi"].mean
    assert float(done.stdout) == pytest.approx(expected)


def test_bad_input_is_refused_and_nothing_is_written_over(run, exported, refused, tmp_path):
    mine = tmp_path / "mine.onnx"
    mine.write_text("mine")
    line = f"{mine}: is there already, and is not written over: name another file"
    assert refused("export", run, "--onnx", mine) == line
    assert mine.read_text() == "mine"
    new = tmp_path / "new.onnx"
    assert refused("export", tmp_path, "--onnx", new).startswith(f"{tmp_path}: holds no ")
    assert "is no folder" in refused("export", run, "--onnx", tmp_path / "no" / "new.onnx")
    assert "Missing option '--onnx'" in refused("export", run)
    line = "pretrained: say for which --scenario, whose actions it is to choose"
    assert refused("export", "pretrained", "--onnx", new) == line
    line = f"--scenario: is for pretrained alone: {run} has one"
    assert refused("export", run, "--onnx", new, "--scenario", "best/k3-fdd") == line
    assert os.listdir(tmp_path) == ["mine.onnx"]  # noqa: PTH208


@pytest.mark.parametrize("module", ["onnx", "onnxruntime", "onnxscript"])
def test_what_is_missing_is_named_before_anything_is_read(refused, monkeypatch, tmp_path, module):
    monkeypatch.setitem(sys.modules, module, None)
    line = refused("export", tmp_path, "--onnx", tmp_path / "new.onnx")
    assert line == f"iout export --onnx needs {module}: pip install -e '.[onnx]' in the clone"
