"""The examples of parts of one's own, run as users run them: programs outside of the package."""

import runpy
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

EXTENDING = Path(__file__).parents[2] / "examples" / "extending"


@pytest.fixture
def table(tmp_path, monkeypatch, forgotten_parts, capsys):
    """Runs an example; the numbers of each line that it prints, by what the line begins with."""

    def run(name, *options):
        path = str(EXTENDING / f"{name}.py")
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", [path, *options])
        runpy.run_path(path, run_name="__main__")
        out, err = capsys.readouterr()
        assert err == ""
        lines = out.splitlines()[1:]
        split = [[word.strip() for word in line.split("  ") if word] for line in lines]
        return {name: [float(number) for number in numbers] for name, *numbers in split}

    return run


def test_reward(table):
    reward = {
        policy: numbers[-1] for policy, numbers in table("reward", "--steps", "12000").items()
    }
    assert reward["untrained"] < reward["random-walk"] < reward["greedy"] < reward["trained"] < 0


def test_observation_entry(table):
    found = table("observation_entry", "--steps", "8000")
    assert [numbers[0] for numbers in found.values()] == [9, 9, 12, 12]
    assert found["greedy, as it is"][1] == found["greedy, and distances"][1]
    assert found["ppo, and distances"][1] != found["ppo, as it is"][1]
    assert found["ppo, and distances"][1] < found["greedy, and distances"][1]


def test_motion(table):
    found = table("motion", "--episodes", "5")
    assert {motion: directions for motion, (directions, _) in found.items()} == {
        "six": 6,
        "knight": 10,
    }
    assert found["six"][1] != found["knight"][1]


def test_access_rule(table):
    found = table("access_rule", "--episodes", "5")
    # What stays silent keeps its energy; what collides has spent it.
    assert found["nearest_first, 2"] < found["nearest_first, 1"] < found["exclusive"]


def test_placement(table):
    found = table("placement", "--episodes", "5")
    assert found["random"] != found["sea_floor"]


def test_the_page_names_every_example():
    page = (EXTENDING / "README.md").read_text()
    assert all(f"`{path.name}`" in page for path in EXTENDING.glob("*.py"))


def test_node_table_network(table):
    """What it has learnt with five nodes serves it with ten."""
    found = table("node_table_network")
    for k in (0, 1):
        assert found["network"][k] < 0.75 * found["greedy"][k] < found["random-walk"][k]
