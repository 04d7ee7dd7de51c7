"""Studies with policies from outside: run where the command line names them, and only there."""

import json
import sys

import pytest
from tiny_study import SETTINGS, write_study

from iout_marl import evaluate, load_scenario

CODE = '''
import numpy as np

class Second:
    """Charges and hears the second node."""
    name = "second"

    def act(self, world, state, rng):
        return np.ones((world.num_envs, world.num_auvs, len(world.action_sizes)), dtype=int)
'''
GROUP = {
    "scenarios": ["paper/k3-fdd"],
    "policies": ["greedy", "second_of_study.py:Second"],
    "episodes": 2,
    "settings": SETTINGS,
    "grid": {"nodes.count": [2, 3]},
}


@pytest.fixture(autouse=True)
def _working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", sys.path[:])
    (tmp_path / "second_of_study.py").write_text(CODE)
    yield
    sys.modules.pop("second_of_study", None)


def study(tmp_path, policy="second_of_study.py:Second"):
    group = {**GROUP, "policies": ["greedy", policy]}
    return write_study(tmp_path / "mine.yaml", groups={"both": group}, quick={})


@pytest.mark.slow
@pytest.mark.parametrize("policy", ["second_of_study.py:Second", "second_of_study:Second"])
def test_worker_processes_play_them(iout, tmp_path, policy):
    words = ["reproduce", "--study", study(tmp_path, policy), "--out", "out", "--jobs", 1]
    status, _, err = iout(*words, "--policy", policy)
    assert status == 0, err
    cells = json.loads((tmp_path / "out" / "results.json").read_text())["cells"]
    found = {
        cell["axis"]: cell["record"]["samples"]["mean_aoi"]
        for cell in cells
        if cell["series"] == policy
    }
    for nodes in (2, 3):
        scenario = load_scenario("paper/k3-fdd", {**SETTINGS, "nodes.count": nodes})
        expected = evaluate(scenario, policy, 2).samples["mean_aoi"]
        assert found[nodes] == pytest.approx(expected)
    assert f"--policy {policy}" in (tmp_path / "out" / "report.md").read_text()


@pytest.mark.parametrize(
    ("listed", "named", "expected"),
    [
        (
            "second_of_study:Second",
            [],
            "groups.both: policies from outside must be named",
        ),
        (
            "second_of_study:Second",
            ["json:dumps"],
            "command line, too: --policy second_of_study:Se",
        ),
        ("round-robin", ["json:dumps"], "--policy json:dumps: the study has no such policy"),
        ("second_of_study:Third", ["second_of_study:Third"], "--policy second_of_study:Third: sec"),
        ("nowhere:x", ["nowhere:x"], "--policy nowhere:x: there is no module 'nowhere'"),
        ("secnod", [], "unknown policy 'secnod'"),
    ],
)
def test_refused_before_anything_is_made_or_imported(refused, tmp_path, listed, named, expected):
    words = [word for name in named for word in ("--policy", name)]
    line = refused("reproduce", "--study", study(tmp_path, listed), "--out", "out", *words)
    assert expected in line
    assert line.startswith("--policy" if named and "too: " not in line else "mine.yaml:")
    assert not (tmp_path / "out").exists()
    assert "second_of_study" not in sys.modules or "Third" in listed
