"""The command that bounds what policies can reach."""

import dataclasses
import json

import pytest

from iout_marl import cli_bound, evaluate, load_scenario
from iout_marl.bounds import bound, delivery_bound
from iout_marl.world import pin_layout

SHORT = ["--set", "episode.duration_s=150"]


@pytest.mark.slow
def test_table_of_bounds_and_policies(iout):
    status, out, err = iout("bound", "paper/k3-tdd", *SHORT, "--policy", "greedy", "--seconds", 1)
    assert (status, err) == (0, "")
    assert "both bounds hold for every policy" in out
    for row in ("scheduling bound", "energy and travel bound", "tour", "planner", "greedy"):
        assert row in out


@pytest.mark.slow
def test_json_has_bounds_gaps_and_certificate(iout, tmp_path):
    status, out, _ = iout("bound", "paper/k3-fdd", *SHORT, "--seconds", 1, "--json", "-")
    assert status == 0
    record = json.loads(out)
    scenario = load_scenario("paper/k3-fdd", {"episode.duration_s": 150})
    planned = evaluate(scenario, "planner", episodes=1).metrics["mean_aoi"].mean
    assert record["scenario_hash"] == scenario.hash
    assert record["scheduling"] == delivery_bound(scenario)
    assert record["scheduling"] <= record["energy_and_travel"] == record["best"] <= planned
    assert record["policies"]["planner"] == {
        "mean_aoi": planned,
        "gap_percent": pytest.approx(100 * (planned / record["best"] - 1)),
        "episodes": 1,
    }
    assert record["certificate"]["kind"] == "branch-and-bound"
    assert record["certificate"]["age_sum"] == round(record["best"] * 18)


@pytest.mark.slow
def test_json_to_a_file_goes_beside_the_table(iout, tmp_path):
    path = tmp_path / "bound.json"
    status, out, _ = iout("bound", "multi/m3-k10-fdd", *SHORT, "--json", path)
    assert status == 0
    assert "the one by energy and travel is for one AUV" in out
    record = json.loads(path.read_text())
    assert record["energy_and_travel"] is None
    assert record["certificate"]["kind"] == "scheduling"
    assert record["best"] == record["scheduling"]


@pytest.mark.slow
def test_the_layout_of_a_run_is_bounded_by_its_seed(iout):
    words = ("bound", "random/k3-fdd", *SHORT, "--seconds", 1, "--json", "-", "--seed")
    found = [json.loads(iout(*words, seed)[1]) for seed in (4, 4, 5)]
    for seed, each in zip((4, 4, 5), found, strict=True):
        assert each["validity"] == (
            f"both bounds hold for every policy; nodes lie where seed {seed} draws them: "
            "the one by energy and travel is for this layout alone"
        )
    assert found[0]["certificate"] == found[1]["certificate"] != found[2]["certificate"]
    layout = pin_layout(load_scenario("random/k3-fdd", {"episode.duration_s": 150}), 4)
    assert found[0]["certificate"]["world_hash"] == layout.world_hash
    assert found[0]["energy_and_travel"] <= found[0]["policies"]["planner"]["mean_aoi"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("redraw", "when"), [("episode", "for every episode"), ("run", "for every run")]
)
def test_random_nodes_have_the_bound_that_holds_and_no_other(iout, redraw, when):
    nodes = f"nodes={{kind: random, count: 3, redraw: {redraw}}}"
    status, out, _ = iout("bound", "paper/k3-fdd", *SHORT, "--set", nodes)
    assert status == 0
    assert f"nodes are drawn {when}: the scheduling bound holds for every layout" in out
    assert "energy and travel bound" not in out


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["paper/k3-fd"], "no scenario 'paper/k3-fd'"),
        (["paper/k3-fdd", "--policy", "gredy"], "--policy gredy: neither a baseline nor"),
        (["paper/k3-fdd", "--seconds", "-1"], "'--seconds': must be at least 0, not -1"),
        (["paper/k3-fdd", "--seconds", "nan"], "'--seconds': must be a number, not 'nan'"),
        (["paper/k3-fdd", "--seconds", "long"], "'--seconds': must be a number, not 'long'"),
        (["paper/k3-fdd", "--set", "age.maximum=0"], "age.maximum: must be"),
    ],
)
def test_bad_input(refused, words, expected):
    assert expected in refused("bound", *words)


@pytest.mark.slow
def test_json_that_cannot_be_written(iout, refused):
    words = ("bound", "multi/m3-k10-fdd", *SHORT, "--json")
    assert "missing/x.json: cannot be written: missing is no folder" in refused(
        *words, "missing/x.json"
    )
    status, out, err = iout(*words, "x" * 300 + ".json")
    assert status == 2
    assert "scheduling bound" in out
    assert "cannot be written: " in err


@pytest.mark.slow
def test_json_is_there_whatever_becomes_of_the_table(iout, tmp_path, monkeypatch):
    path = tmp_path / "bound.json"

    def no_table(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(cli_bound, "_print", no_table)
    status, _, err = iout("bound", "multi/m3-k10-fdd", *SHORT, "--json", path)
    assert status == 2
    assert "No space left" in err
    assert json.loads(path.read_text())["certificate"]["kind"] == "scheduling"


@pytest.mark.slow
def test_policies_are_counted_one_by_one(iout):
    words = ("bound", "paper/k3-fdd", *SHORT, "--seconds", 0)
    assert "Played: 1 episode of each policy, from seed 0 on." in iout(*words)[1]
    nodes = "nodes={kind: random, count: 2, redraw: episode}"
    out = iout(*words, "--set", nodes, "--seed", 3)[1]
    assert "Played: 20 episodes of each policy, from seed 3 on." in out


@pytest.mark.slow
@pytest.mark.parametrize(("off", "text"), [(1e-15, "0.0 %"), (1e-4, "-0.1 %"), (0.3, "-30.0 %")])
def test_a_policy_below_a_bound_is_an_alarm_and_rounding_is_none(iout, monkeypatch, off, text):
    def too_high(scenario, best_known, seconds):
        found = bound(scenario, seconds=0)
        return dataclasses.replace(found, energy_and_travel=best_known / (1 - off))

    monkeypatch.setattr("iout_marl.bounds.bound", too_high)
    out = iout("bound", "paper/k3-fdd", *SHORT)[1]
    assert text in out
    assert "-0.0" not in out
    assert ("planner: below a verified bound" in out) == (off > 1e-10)
