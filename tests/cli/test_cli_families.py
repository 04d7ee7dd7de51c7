"""Members of a user's families, wherever the command line takes a scenario."""

import json

import pytest

from iout_marl import load_scenario


@pytest.fixture(autouse=True)
def family(tmp_path, monkeypatch):
    """A family in the working folder."""
    monkeypatch.chdir(tmp_path)
    text = "extends: best/k3-{duplex}\nmatrix: {axes: {duplex: {fdd: {}, tdd: {}}}}\n"
    (tmp_path / "mine.yaml").write_text(text)


def test_a_member_is_trained_and_evaluated(iout, tiny_settings, tmp_path):
    status, _, _ = iout("train", "mine/tdd", *tiny_settings, "--steps", 80)
    assert status == 0
    (run,) = (tmp_path / "runs").rglob("scenario.yaml")
    scenario = load_scenario(run)
    assert (scenario.name, scenario.duplex.kind) == ("mine/tdd", "tdd")
    assert "matrix" not in run.read_text()
    words = ["--policy", run.parent, "--episodes", 1, "--json", "-"]
    status, out, _ = iout("evaluate", "mine.yaml/tdd", *tiny_settings, *words)
    assert (status, json.loads(out)["scenario"]) == (0, "mine/tdd")


def test_a_member_is_shown_with_overrides(iout):
    status, out, _ = iout("show", "mine/fdd", "--set", "age.maximum=7")
    assert status == 0
    assert "name: mine/fdd\n" in out
    assert "maximum: 7\n" in out


def test_a_family_is_not_shown_itself(refused):
    expected = "mine.yaml: is a family, name one of its scenarios: mine/fdd, mine/tdd"
    assert refused("show", "mine.yaml") == expected
    assert refused("train", "mine") == expected
    assert refused("evaluate", "mine/fd").endswith("no member 'fd'; did you mean 'fdd'?")


def test_a_familys_file_is_not_written_over(refused):
    words = ["evaluate", "mine/fdd", "--policy", "greedy", "--episodes", 1, "--json", "mine.yaml"]
    assert "mine.yaml: must end in .json" in refused(*words)
