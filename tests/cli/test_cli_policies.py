"""Policies by name and folder: who plays where, by which actions, and what was meant."""

import json
import shutil

import pytest

import trainers
from iout_marl.scenario import load_scenario
from iout_marl.words import counted, listed

ODD_NAMES = ("q[/lr]", "[bold]b", "a b")


@pytest.fixture(autouse=True)
def _working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def by_run(tiny_settings):
    """Words of the tiny scenario with a layout that is drawn once for a run."""
    settings = [s for s in tiny_settings[1::2] if not s.startswith("nodes.")]
    settings.append("nodes={kind: random, count: 2, redraw: run}")
    return ["best/k3-fdd", *(word for s in settings for word in ("--set", s))]


@pytest.fixture(scope="module")
def trained(tmp_path_factory, by_run):
    """Three runs, each with a layout of its own, and two side by side."""
    folder = tmp_path_factory.mktemp("runs")
    scenario = load_scenario(by_run[0], by_run[2::2])
    for seed, name in enumerate(ODD_NAMES):
        # The run of a name with a slash lies in a folder within a folder.
        trainers.train(scenario, folder / name, seed, evaluation_episodes=1)
    trainers.train(scenario, folder / "group", 7, evaluation_episodes=1, replicas=2)
    return folder


@pytest.fixture
def runs(trained, tmp_path):
    shutil.copytree(trained, tmp_path, dirs_exist_ok=True)
    return ODD_NAMES


def policies(*names):
    return [word for name in names for word in ("--policy", name)]


@pytest.mark.slow
class TestLayouts:
    def evaluated(self, iout, by_run, *words):
        status, out, err = iout("evaluate", *by_run, "--episodes", 3, *words, "--json", "-")
        assert status == 0, err
        return json.loads(out)

    @pytest.mark.slow
    def test_each_run_plays_in_its_own(self, iout, by_run, runs):
        together = self.evaluated(iout, by_run, *policies(*runs))
        assert together == [self.evaluated(iout, by_run, *policies(run)) for run in runs]
        assert len({record["scenario_hash"] for record in together}) == 3

    @pytest.mark.slow
    def test_baselines_play_in_that_of_the_first_run(self, iout, by_run, runs):
        words = policies("greedy", runs[1], runs[0], "tour")
        hashes = [record["scenario_hash"] for record in self.evaluated(iout, by_run, *words)]
        assert hashes[0] == hashes[1] == hashes[3] != hashes[2]

    def test_baselines_alone_play_in_that_of_the_seed(self, iout, by_run):
        words = policies("greedy", "tour")
        found = [self.evaluated(iout, by_run, *words, "--seed", seed) for seed in (1, 2)]
        assert len({record["scenario_hash"] for records in found for record in records}) == 2

    def test_by_transfer_all_play_in_that_of_the_first_run(self, iout, by_run, runs):
        words = [*policies("greedy", *runs), "--transfer"]
        hashes = {record["scenario_hash"] for record in self.evaluated(iout, by_run, *words)}
        assert len(hashes) == 1

    def test_the_table_says_who_plays_where(self, iout, by_run, runs):
        words = [*policies("greedy", *runs), "--episodes", 3]
        status, out, _ = iout("evaluate", *by_run, *words)
        assert status == 0
        heading, whose, what, *_ = out.splitlines()
        assert heading == (
            "best/k3-fdd, each run in its own layout, greedy in that of q[/lr], seed 0"
        )
        assert whose == (
            "3 episodes of greedy; 1 episode (deterministic) of q[/lr], [bold]b and a b"
        )
        assert what == "mean ± half of the 95 % confidence interval"
        layouts = next(line for line in out.splitlines() if "layout  " in line)
        assert len(set(layouts.split()[3::2])) == 3

    def test_of_policies_trained_side_by_side(self, iout, by_run):
        words = ["train", *by_run, "--replicas", 2, "--out", "two", "--steps", 80]
        status, out, _ = iout(*words)
        assert status == 0
        assert out.startswith(
            "evaluation by most probable actions:\n"
            "best/k3-fdd, each in a layout of its own: 1 episode (deterministic), seed 0\n"
        )
        assert "│ layout " in out
        assert "±" not in out

    def test_of_many_policies(self, iout, by_run):
        words = ["train", *by_run, "--replicas", 5, "--out", "five", "--steps", 80]
        _, out, _ = iout(*words)
        assert out.startswith(
            "evaluation by most probable actions:\n"
            "best/k3-fdd, each in a layout of its own: 5 policies, 1 episode (deterministic) each,"
        )


class TestSampled:
    def record(self, iout, by_run, *words):
        status, out, err = iout("evaluate", *by_run, *words, "--sampled", "--json", "-")
        assert status == 0, err
        return json.loads(out)

    def test_is_chance(self, iout, by_run, runs):
        record = self.record(iout, by_run, *policies(runs[0]), "--episodes", 4)
        assert (record["sampled"], record["episodes"], record["deterministic"]) == (True, 4, False)
        assert record["policy"] == runs[0]
        assert all(metric["ci95"] is not None for metric in record["metrics"].values())

    def test_episodes_are_those_of_their_seeds(self, iout, by_run, runs):
        words = policies(runs[0])
        means = [
            self.record(iout, by_run, *words, "--episodes", count, "--seed", seed)["metrics"]
            for count, seed in ((3, 5), (1, 5), (1, 6), (1, 7))
        ]
        together, *alone = [metrics["mean_aoi"]["mean"] for metrics in means]
        assert together == pytest.approx(sum(alone) / 3)
        assert len(set(alone)) > 1

    def test_is_said_of_trained_policies_alone(self, iout, by_run, runs):
        words = [*policies(runs[0], "greedy"), "--episodes", 2]
        records = self.record(iout, by_run, *words)
        assert ["sampled" in record for record in records] == [True, False]
        _, out, _ = iout("evaluate", *by_run, *words, "--sampled")
        assert "q[/lr] (sampled)" in out
        assert "greedy (sampled)" not in out
        assert ": 2 episodes, seed 0" in out

    def test_needs_a_trained_policy(self, refused):
        line = refused("evaluate", "paper/k3-fdd", "--policy", "greedy", "--sampled")
        assert line.startswith("--sampled: none of the policies is a trained one")


class TestSearch:
    @pytest.mark.slow
    def test_is_no_worse(self, iout, tmp_path):
        target = tmp_path / "found.json"
        words = ["--policy", "pretrained", "--policy", "greedy", "--episodes", 1]
        found = []
        for search in ([], ["--beam", 2]):
            status, out, _ = iout("evaluate", "best/k5-tdd", *words, *search, "--json", target)
            assert status == 0
            found.append([r["metrics"]["mean_aoi"]["mean"] for r in json.loads(target.read_text())])
        assert "pretrained, beam of 2" in out
        assert found[1][0] < found[0][0]
        assert found[1][1] == found[0][1]

    @pytest.mark.slow
    def test_is_named_in_the_episode_that_is_kept(self, iout, tmp_path):
        target = tmp_path / "episode.json"
        words = ["--policy", "pretrained", "--mirrored", "--save-episode", target]
        assert iout("evaluate", "best/k3-tdd", *words)[0] == 0
        assert json.loads(target.read_text())["policy"] == "pretrained, mirrored"

    @pytest.mark.parametrize(
        ("words", "message"),
        [
            (["greedy", "--beam", 2], "--beam: none of the policies is a trained one"),
            (["pretrained", "--beam", 2, "--sampled"], "--beam: decides itself what is drawn"),
            (["pretrained", "--beam", 2, "--mirrored"], "--beam: is a search of its own; leave"),
            (
                ["pretrained", "--best-of", 2, "--sampled"],
                "--best-of: decides itself what is drawn",
            ),
            (["pretrained", "--beam", 0], "Invalid value for '--beam': must be at least 1"),
        ],
    )
    def test_refused(self, refused, words, message):
        assert message in refused("evaluate", "paper/k3-fdd", "--policy", *words)


class TestNames:
    def test_that_look_like_markup_are_shown_as_they_are(self, iout, by_run, runs):
        status, out, _ = iout("evaluate", *by_run, *policies(*runs, "greedy"), "--episodes", 2)
        assert status == 0
        assert all(name in out.splitlines()[-12] + out for name in runs)
        headings = next(line for line in out.splitlines() if line.startswith("┃"))
        assert [h.strip() for h in headings.split("┃")[2:-1]] == [*runs, "greedy"]

    def test_of_a_scenario_too(self, iout):
        name = r"[red]x\x1b[31m[/nope]"
        status, out, _ = iout(
            "evaluate", "paper/k3-fdd", "--policy", "tour", "--set", f'name="{name}"'
        )
        assert status == 0
        assert out.startswith(r"[red]x\x1b[31m[/nope] (")

    def test_of_equal_last_parts_have_headings_of_their_own(self, iout, by_run, runs, tmp_path):
        for place in ("here", "there"):
            shutil.copytree(tmp_path / "a b", tmp_path / place / "mine")
        _, out, _ = iout("evaluate", *by_run, *policies("here/mine", "there/mine"))
        assert "here/mine" in out
        assert "there/mine" in out

    def test_folder_of_policies_trained_side_by_side(self, refused, by_run, runs):
        line = refused("evaluate", *by_run, *policies("group"))
        assert line == (
            "--policy group: holds no trained policy, but folders that do: "
            "--policy group/seed-7 --policy group/seed-8"
        )

    def test_folder_of_runs_names_those_that_hold_a_policy(self, refused, by_run, runs, tmp_path):
        (tmp_path / "group" / "seed-7" / "policy.safetensors").unlink()
        line = refused("evaluate", *by_run, *policies("group"))
        assert line.endswith("folders that do: --policy group/seed-8")

    def test_folder_of_runs_is_quoted_and_cut_short(self, refused, by_run, runs, tmp_path):
        for i in range(10):
            shutil.copytree(tmp_path / "a b", tmp_path / "my runs" / f"seed-{i}")
        words = policies("greedy", "my runs")
        line = refused("evaluate", *by_run, *words)
        assert "--policy 'my runs/seed-0' --policy 'my runs/seed-1'" in line
        assert line.endswith("--policy 'my runs/seed-7' and 2 more")

    @pytest.mark.parametrize(
        ("name", "meant"),
        [
            ("gredy", "'greedy'"),
            ("group/sed-7", "group/seed-7"),
            ("group/seed-77", "group/seed-7"),
            ("ab", "'a b'"),
            ("mine", "runs/mine"),
        ],
    )
    def test_what_was_meant(self, refused, by_run, runs, tmp_path, name, meant):
        shutil.copytree(tmp_path / "a b", tmp_path / "runs" / "mine")
        line = refused("evaluate", *by_run, *policies(name))
        assert line.endswith(f"; did you mean {meant}?")

    def test_file(self, refused, by_run, runs):
        line = refused("evaluate", *by_run, *policies("a b/scenario.yaml"))
        assert line == "--policy a b/scenario.yaml: is a file, not the folder of a run"

    def test_all_are_looked_up_before_the_first_plays(self, refused, monkeypatch):
        monkeypatch.setattr("iout_marl.cli_policies.evaluate", lambda *_: pytest.fail("played"))
        assert refused("evaluate", "paper/k3-fdd", *policies("greedy", "gredy"))


def test_words():
    assert [counted(n, "episode") for n in (0, 1, 2, 1000)] == [
        *("0 episodes", "1 episode", "2 episodes", "1,000 episodes")
    ]
    assert counted(2, "policy", "policies") == "2 policies"
    assert [listed(list("abc"[:n])) for n in range(4)] == ["", "a", "a and b", "a, b and c"]
