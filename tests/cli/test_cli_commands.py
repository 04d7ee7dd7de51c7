"""What each command does when all is well."""

import json
import re
import subprocess
import sys

import pytest
import typer

import iout_marl
from iout_marl import bundled_names, evaluate, load_scenario
from iout_marl.cli import COMMANDS, app


@pytest.fixture(autouse=True)
def _working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def trained(tmp_path_factory, tiny):
    """The folder of a run of the tiny scenario."""
    import trainers

    folder = tmp_path_factory.mktemp("trained") / "run"
    trainers.train(tiny(), folder, evaluation_episodes=1)
    return folder


def test_version(iout):
    assert iout("--version") == (0, f"{iout_marl.__version__}\n", "")


@pytest.mark.parametrize("words", [[], ["--help"]])
def test_help_names_every_command(iout, words):
    status, out, err = iout(*words)
    assert (status, err) == (0, "")
    assert all(re.search(rf"^  {command} +\S", out, re.MULTILINE) for command in COMMANDS)


def test_what_the_help_says_of_a_command_is_how_its_own_begins():
    for name, command in typer.main.get_command(app).commands.items():
        _, beginning = COMMANDS[name]
        assert beginning.endswith(".")
        assert " ".join(command.help.split()).startswith(beginning.removesuffix("."))


@pytest.mark.slow
def test_help_imports_no_library_of_numbers():
    program = """
import sys
from iout_marl.cli import _run
assert _run(["--help"]) == (0, "")
print(sorted({"numpy", "pydantic", "gymnasium", "pettingzoo", "torch"} & sys.modules.keys()))
"""
    command = [sys.executable, "-m", "iout_marl", "--help"]
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.orig_argv = {command!r}\n{program}"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.endswith("\n[]\n")


@pytest.mark.slow
@pytest.mark.parametrize("command", [name for name in COMMANDS if name != "scenario"])
def test_help_of_each_command(iout, command):
    status, out, err = iout(command, "--help")
    assert (status, err) == (0, "")
    assert f"Usage: iout {command} [OPTIONS]" in out


@pytest.mark.slow
def test_module_is_the_command():
    command = [sys.executable, "-m", "iout_marl", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == f"{iout_marl.__version__}\n"


@pytest.mark.slow
def test_scenarios_are_listed_one_a_line(iout):
    status, out, _ = iout("scenarios")
    heading, *lines = out.splitlines()
    assert status == 0
    assert heading.split() == ["scenario", "nodes", "AUVs", "duplex", "reward"]
    assert [line.split()[0] for line in lines] == bundled_names()
    for line in lines:
        name, nodes, auvs, duplex, reward, *description = line.split()
        scenario = load_scenario(name)
        assert (int(nodes), int(auvs)) == (scenario.num_nodes, scenario.num_auvs)
        assert (duplex, reward) == (scenario.duplex.kind, scenario.reward.kind)
        assert " ".join(description) == scenario.description


@pytest.mark.parametrize("name", ["paper/k3-fdd", "best/k10-tdd"])
def test_show_prints_what_can_be_loaded(iout, tmp_path, name):
    status, out, err = iout("show", name)
    scenario = load_scenario(name)
    assert (status, err) == (0, "")
    assert out.startswith(f"# hash {scenario.hash}, of the world alone {scenario.world_hash}\n")
    (tmp_path / "shown.yaml").write_text(out, encoding="utf-8")
    assert load_scenario("shown.yaml") == scenario


def test_show_with_changes(iout, tmp_path):
    status, out, _ = iout(
        "show", "paper/k3-fdd", "--set", "age.maximum=40", "--set", "auvs.start_cells=[[1, 1, 1]]"
    )
    assert status == 0
    (tmp_path / "shown.yaml").write_text(out, encoding="utf-8")
    shown = load_scenario("shown.yaml")
    assert shown.age.maximum == 40
    assert shown.auvs.start_cells == ((1, 1, 1),)


def test_show_of_a_file(iout, tmp_path):
    (tmp_path / "mine.yaml").write_text("extends: paper/k3-fdd")
    status, out, _ = iout("show", "mine.yaml")
    assert status == 0
    assert "name: mine" in out


def test_show_says_that_energy_does_not_matter_and_can_be_loaded_again(iout, tmp_path):
    changes = ["harvester.sensitivity_db=150", "allow_implausible=[harvester.sensitivity_db]"]
    words = [word for change in changes for word in ("--set", change)]
    status, out, err = iout("show", "paper/k3-fdd", *words)
    assert (status, err) == (0, "")
    lines = out.splitlines()
    assert lines[1].startswith("# energy can never bind: a slot harvests 5.89e+30 J to ")
    (tmp_path / "shown.yaml").write_text(out, encoding="utf-8")
    shown = load_scenario("shown.yaml")
    assert shown.allow_implausible == ("harvester.sensitivity_db",)
    assert lines[0].startswith(f"# hash {shown.hash}, ")


def test_train_and_evaluate(iout, tiny_settings, tmp_path):
    status, out, err = iout("train", "best/k3-fdd", *tiny_settings, "--out", "run", "--seed", 4)
    assert status == 0
    assert "the run is in run" in out
    assert "note: energy can never bind: " in err
    assert "Traceback" not in err
    result = json.loads((tmp_path / "run/result.json").read_text())
    assert (result["seed"], result["evaluation"]["episodes"]) == (4, 1)

    words = ["evaluate", "best/k3-fdd", *tiny_settings, "--policy", "run", "--json", "-"]
    status, out, err = iout(*words)
    assert status == 0
    assert err == (
        "note: energy can never bind: a slot harvests 192 J to 842 J, "
        "and the dearest uplink takes 79.7 J\n"
    )
    assert json.loads(out) == result["evaluation"]


def test_train_by_default_into_a_folder_named_after_scenario_and_seed(
    iout, tiny_settings, tmp_path
):
    status, _, _ = iout("train", "best/k3-fdd", *tiny_settings, "--seed", 2, "--steps", 80)
    assert status == 0
    assert (tmp_path / "runs/best-k3-fdd-s2/result.json").is_file()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["../../x", "a b/c", "ä:\\n", '"x\\0y"'])
def test_no_name_leads_out_of_the_folder_of_runs(iout, tiny_settings, tmp_path, name):
    words = ["train", "best/k3-fdd", *tiny_settings, "--set", f"name={name}", "--steps", 80]
    status, _, err = iout(*words)
    assert status == 0, err
    (run,) = (tmp_path / "runs").iterdir()
    assert (run / "result.json").is_file()


def test_steps_go_before_the_scenario(iout, tiny_settings, tmp_path):
    iout("train", "best/k3-fdd", *tiny_settings, "--out", "run", "--steps", 160)
    assert len((tmp_path / "run/metrics.jsonl").read_text().splitlines()) == 2


def test_run_may_be_resumed_with_its_own_folder_as_out(iout, tiny_settings):
    words = ["train", "best/k3-fdd", *tiny_settings]
    assert iout(*words, "--out", "run")[0] == 0
    assert iout(*words, "--out", "run", "--resume", "run")[0] == 0


@pytest.mark.slow
def test_progress_goes_to_standard_error(iout, tiny_settings):
    _, out, err = iout("train", "best/k3-fdd", *tiny_settings, "--out", "run")
    assert "100%" in err
    assert "steps/s" not in out


def test_evaluate_prints_a_table_of_all_baselines(iout):
    status, out, err = iout("evaluate", "paper/k3-fdd", "--episodes", 3)
    assert (status, err) == (0, "")
    assert out.startswith("paper/k3-fdd (2a966538b64d), seed 0\n")
    assert "\n3 episodes of random-walk, round-robin and greedy; 1 episode (deterministic)" in out
    assert " of tour\nmean ± half of the 95 % confidence interval" in out
    assert re.search(r"random-walk .*round-robin .*greedy", out)
    assert re.search(r"mean AoI +(│ +\d+\.\d\d ± \d+\.\d\d ){3}│ +\d+\.\d\d │", out)


def test_evaluate_of_one_episode_shows_no_interval(iout):
    status, out, _ = iout("evaluate", "paper/k3-fdd", "--episodes", 1, "--policy", "greedy")
    assert status == 0
    assert "nan" not in out
    assert ": 1 episode, seed 0\n" in out
    assert "±" not in out


def test_evaluate_without_chance_plays_one_episode_and_says_so(iout):
    words = ["evaluate", "paper/k3-fdd", "--episodes", 7, "--policy", "tour"]
    status, out, err = iout(*words)
    assert (status, err) == (0, "")
    assert ": 1 episode (deterministic), seed 0\n" in out
    assert "±" not in out
    record = json.loads(iout(*words, "--json", "-")[1])
    assert (record["episodes"], record["deterministic"]) == (1, True)
    assert all(metric["ci95"] is None for metric in record["metrics"].values())


def test_json_to_standard_output_is_all_that_is_printed(iout):
    words = ["evaluate", "paper/k3-tdd", "--policy", "greedy", "--episodes", 3, "--seed", 5]
    status, out, err = iout(*words, "--json", "-")
    assert (status, err) == (0, "")
    assert json.loads(out) == evaluate("paper/k3-tdd", "greedy", 3, 5).to_json()


def test_json_to_a_file_goes_beside_the_table(iout, tmp_path):
    words = ["evaluate", "paper/k3-tdd", "--policy", "greedy", "--episodes", 3]
    status, out, _ = iout(*words, "--json", "figures.json")
    assert status == 0
    assert "greedy" in out
    record = json.loads((tmp_path / "figures.json").read_text())
    assert record == evaluate("paper/k3-tdd", "greedy", 3).to_json()


def test_json_of_several_policies_is_a_list(iout):
    words = ["--policy", "greedy", "--policy", "random-walk", "--episodes", 2]
    _, out, _ = iout("evaluate", "paper/k3-tdd", *words, "--json", "-")
    assert [record["policy"] for record in json.loads(out)] == ["greedy", "random-walk"]


def test_same_command_same_figures(iout):
    words = ["evaluate", "paper/k3-tdd", "--episodes", 3, "--seed", 1, "--json", "-"]
    assert iout(*words) == iout(*words)


def test_changes_of_the_scenario_are_part_of_the_record(iout):
    words = ["evaluate", "paper/k3-tdd", "--policy", "greedy", "--episodes", 2, "--json", "-"]
    _, out, _ = iout(*words, "--set", "age.maximum=30")
    expected = load_scenario("paper/k3-tdd", {"age.maximum": 30}).hash
    assert json.loads(out)["scenario_hash"] == expected


@pytest.mark.slow
def test_run_in_another_world_is_evaluated_by_transfer(iout, trained, tiny_settings):
    words = ["evaluate", "best/k3-fdd", *tiny_settings, "--set", "age.maximum=14"]
    status, out, _ = iout(*words, "--policy", trained, "--transfer", "--json", "-")
    assert status == 0
    assert json.loads(out)["policy"] == str(trained)


@pytest.mark.slow
def test_planner_may_start_from_a_run(iout, trained, tiny_settings):
    def mean_age(*words):
        _, out, _ = iout("evaluate", "best/k3-fdd", *tiny_settings, *words, "--json", "-")
        return json.loads(out)["metrics"]["mean_aoi"]["mean"]

    budget = ("--policy", "planner", "--planner-rounds", "0")
    both = mean_age(*budget, "--planner-start", trained, "--transfer")
    assert both <= min(mean_age(*budget), mean_age("--policy", trained, "--transfer"))
    assert mean_age("--policy", "planner", "--planner-seconds", "0") == mean_age(*budget)


def test_figures_do_not_depend_on_who_else_is_evaluated(iout, trained, tiny_settings):
    words = ["evaluate", "best/k3-fdd", *tiny_settings, "--episodes", 2, "--json", "-"]
    alone = json.loads(iout(*words, "--policy", trained)[1])
    beside = json.loads(iout(*words, "--policy", "greedy", "--policy", trained)[1])
    assert beside[1] == alone


@pytest.mark.slow
def test_baselines_need_no_torch():
    program = (
        "import sys; from iout_marl.cli import main\n"
        "try: main(sys.argv[1:])\n"
        "except SystemExit: print([m for m in ('torch', 'matplotlib') if m in sys.modules])"
    )
    words = ["evaluate", "paper/k3-fdd", "--episodes", "2"]
    command = [sys.executable, "-c", program, *words]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.endswith("\n[]\n")


def test_baselines_beside_a_run_play_on_its_layout(iout, tmp_path, tiny_settings):
    settings = [s for s in tiny_settings[1::2] if not s.startswith("nodes.")]
    settings.append("nodes={kind: random, count: 2, redraw: run}")
    words = ["best/k3-fdd", *(word for s in settings for word in ("--set", s))]
    assert iout("train", *words, "--out", tmp_path / "run", "--seed", 1)[0] == 0
    rows = ["--policy", "greedy", "--policy", tmp_path / "run", "--episodes", 2, "--json", "-"]
    status, out, err = iout("evaluate", *words, *rows)
    assert status == 0
    assert err.startswith("note: energy can never bind: ")
    assert len({record["scenario_hash"] for record in json.loads(out)}) == 1
