"""The examples for libraries of the test environment learn, on a tiny scenario; others do what they
say.

Those for other libraries need environments of their own: `make integrations`.
"""

import importlib.util
import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from common import SETTINGS, mean_aoi

EXAMPLES = Path(__file__).parents[2] / "examples"
#: A node in each of the six cells, three AUVs, and little power to charge by: random actions
#: leave a mean AoI of 4.7 slots.
HARDER = {
    "nodes.cells": [[x, y, 1] for x in (1, 2, 3) for y in (1, 2)],
    "nodes.count": 6,
    "charging.power_w": 100,
    "auvs.count": 3,
}
#: Slots. Half the 95 % interval of 100 episodes of random actions is 0.1.
MARGIN = 0.25


def load_example(name):
    """The module of an example."""
    path = EXAMPLES / name
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def example(request, tiny):
    """The module of an example that trains, and the scenario for it."""
    return load_example(f"train_{request.param}.py"), tiny(HARDER | SETTINGS)


def assert_learns(mean_aoi, parameters, learn):
    parameters = list(parameters)
    untrained = [parameter.clone() for parameter in parameters]
    before = mean_aoi()
    learn()
    assert not any(torch.equal(a, b) for a, b in zip(untrained, parameters, strict=True))
    assert mean_aoi() < before - MARGIN


@pytest.mark.slow
@pytest.mark.parametrize("example", ["sb3"], indirect=True)
def test_stable_baselines3_learns(example):
    module, scenario = example
    model = module.make_model(scenario, seed=0)
    policy = module.policy_of(model)
    assert_learns(
        lambda: mean_aoi(scenario, policy),
        model.policy.parameters(),
        lambda: model.learn(8_000),
    )


# TorchRL names the one version of PettingZoo that it is tested with.
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:PettingZoo in TorchRL is tested using version")
@pytest.mark.parametrize("example", ["torchrl"], indirect=True)
def test_mappo_of_torchrls_parts_learns(example):
    module, scenario = example
    mappo = module.MAPPO(scenario, seed=0)
    assert_learns(
        lambda: mean_aoi(scenario, mappo.policy),
        mappo.loss.parameters(),
        lambda: mappo.learn(8_000),
    )


@pytest.mark.slow
def test_scaling_by_the_space_erases_energies_and_by_the_ranges_does_not(capsys):
    spread = load_example("scaling.py").main("paper/k3-fdd")
    assert spread["space"] < 0.01
    assert 0.1 < spread["ranges"] < 10
    assert "energies" in capsys.readouterr().out


def test_policy_of_ones_own(iout):
    """Evaluated in Python, played by hand, and named on the command line."""
    path = EXAMPLES / "extending" / "policy.py"
    found = load_example(path.relative_to(EXAMPLES)).main()
    assert found["oldest-first"] < found["greedy"] - 1
    assert found["oldest-first, by hand"] == pytest.approx(found["oldest-first"], rel=1e-12)
    names = [f"{path}:{name}" for name in ("OldestFirst", "hear_the_oldest")]
    words = [word for name in names for word in ("--policy", name)]
    status, out, _ = iout("evaluate", "paper/k10-fdd", *words, "--episodes", 20, "--json", "-")
    assert status == 0
    means = [record["metrics"]["mean_aoi"]["mean"] for record in json.loads(out)]
    assert means == [found["oldest-first"], found["function"]]
    # The same policy moves several AUVs, and in TDD.
    for scenario in ("multi/m3-k10-fdd", "paper/k3-tdd"):
        assert iout("evaluate", scenario, *words[:2])[0] == 0


#: Losses at 10, 35.2, 138 and 600 m by kHz and depths, as Bellhop gives them for the example's sea:
#: that of aubellhop 0.2.1, incoherent, Gaussian beams.
BELLHOP_DB = {
    (40.0, 20.0, 50.0): (29.464, 32.340, 40.384, 55.135),
    (30.0, 35.0, 35.0): (19.980, 30.258, 39.660, 52.241),
    (30.0, 50.0, 20.0): (29.281, 32.078, 39.681, 52.274),
}


@pytest.mark.parametrize("place", BELLHOP_DB, ids=str)
def test_images_lose_what_bellhop_says(place):
    khz, auv_m, node_m = place
    range_m = np.array([10.0, 35.2471, 137.9878, 600.0])
    found = load_example("transmission_loss.py").images_db(khz, range_m, auv_m, node_m)
    assert found == pytest.approx(BELLHOP_DB[place], abs=0.05)


@pytest.mark.parametrize(
    ("grazing_deg", "size"),
    [(5, 0.9509356213937), (24, 0.7904670843878), (26, 0.6862881290161), (80, 0.3542117916312)],
)
def test_the_bottom_reflects_as_arlpy_says(grazing_deg, size):
    found = load_example("transmission_loss.py").bottom_reflection(np.radians(grazing_deg))
    assert found == pytest.approx(size, rel=1e-12)


def test_a_table_of_losses_is_written_and_used(tmp_path, monkeypatch, capsys):
    out = tmp_path / "loss.npz"
    monkeypatch.setattr(sys, "argv", ["transmission_loss.py", "--out", str(out)])
    load_example("transmission_loss.py").main()
    *losses, formula, table = capsys.readouterr().out.splitlines()
    assert len(losses) == 3
    assert formula.startswith("formula: mean AoI ")
    assert table.startswith("table: mean AoI ")
    assert formula.removeprefix("formula") != table.removeprefix("table")


@pytest.mark.skipif(shutil.which("bellhop.exe") is None, reason="needs Bellhop on the path")
def test_bellhop_gives_the_table_of_images():
    example = load_example("transmission_loss.py")
    range_m, depth_m = np.array([10.0, 100.0, 500.0]), np.array([20.0, 50.0])
    found = example.bellhop_db("bellhop.exe", 30.0, range_m, 20.0, depth_m)
    for i, node_m in enumerate(depth_m):
        wanted = example.images_db(30.0, range_m, 20.0, node_m)
        assert found[:, i] == pytest.approx(wanted, abs=0.1)
