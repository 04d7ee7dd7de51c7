"""What an extra brings is asked for in one line, before anything is done; all else needs none."""

import importlib
import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import gymnasium
import pytest
import tiny_study

from iout_marl import InputError, iout_v0
from iout_marl.envs import sb3_vec_env, supersuit_vec_env
from iout_marl.extras import EXTRAS, missing, require
from iout_marl.study.cluster import DaskCluster

PROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]
HIDDEN = [module for modules in EXTRAS.values() for module in modules]
#: Heavy, or of an extra: `import iout_marl` and `iout --help` do without.
HEAVY = [*HIDDEN, "pandas", "scipy", "supersuit", "tensorboard", "torch", "trainers.ppo"]
PIXELS = {
    "parallel": lambda: iout_v0.parallel_env("paper/k3-fdd", "rgb_array"),
    "aec": lambda: iout_v0.env("paper/k3-fdd", "rgb_array"),
    "gymnasium": lambda: gymnasium.make("iout_marl:AUV-v0", render_mode="rgb_array"),
    "vector": lambda: gymnasium.make_vec(
        "iout_marl:AUV-v0", vectorization_mode="vector_entry_point", render_mode="rgb_array"
    ),
    "sb3": lambda: sb3_vec_env("paper/k3-fdd", 1, render_mode="rgb_array"),
}


@pytest.fixture
def hide(monkeypatch, tmp_path):
    """Hides modules as if they were not installed, in an empty working folder."""
    monkeypatch.chdir(tmp_path)
    return lambda *modules: [monkeypatch.setitem(sys.modules, each, None) for each in modules]


def names(requirements):
    """The packages, by names that are alike however they are written."""
    found = (re.match(r"[\w.-]+", each)[0] for each in requirements)
    return {name.lower().replace("-", "_") for name in found}


def test_extras_are_those_of_the_package():
    optional = PROJECT["optional-dependencies"]
    for extra, modules in EXTRAS.items():
        assert set(modules) <= names(optional[extra])
        assert not names(optional[extra]) & names(PROJECT["dependencies"])
    assert optional["all"] == [f"iout-marl[{','.join(EXTRAS)}]"]


@pytest.mark.parametrize("module", EXTRAS["report"])
@pytest.mark.parametrize(
    "words",
    [["report", "."], ["reproduce"], ["reproduce", "--quick", "--study", "gap"]],
    ids="-".join,
)
def test_reports_need_theirs_before_anything_is_computed(hide, refused, tmp_path, words, module):
    hide(module)
    expected = f"iout {words[0]} needs {module}: pip install -e '.[report]' in the clone"
    assert refused(*words) == expected
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("module", EXTRAS["report"])
def test_the_package_of_reports_says_so_itself(hide, monkeypatch, module):
    monkeypatch.delitem(sys.modules, "iout_marl.report.writer", raising=False)
    hide(module)
    with pytest.raises(InputError, match=rf"^iout_marl\.report needs {module}: pip install -e "):
        importlib.import_module("iout_marl.report.writer")


@pytest.mark.parametrize("make", PIXELS.values(), ids=PIXELS)
def test_pixels_need_matplotlib_when_they_are_asked_for(hide, make):
    hide("matplotlib")
    with pytest.raises(InputError) as raised:
        make()
    line = "render_mode='rgb_array' needs matplotlib: pip install -e '.[report]' in the clone"
    assert str(raised.value) == line


def test_text_and_a_part_of_the_extra_will_do(hide):
    hide("jinja2", "plotly")
    assert iout_v0.parallel_env("paper/k3-fdd", "rgb_array").render_mode == "rgb_array"
    hide("matplotlib")
    env = iout_v0.parallel_env("paper/k3-fdd", "ansi")
    env.reset(seed=0)
    assert "paper/k3-fdd" in env.render()


@pytest.mark.parametrize("make", [sb3_vec_env, supersuit_vec_env])
def test_stable_baselines3(hide, make):
    hide("stable_baselines3")
    with pytest.raises(InputError) as raised:
        make("paper/k3-fdd", 1)
    line = f"{make.__name__} needs stable_baselines3: pip install -e '.[sb3]' in the clone"
    assert str(raised.value) == line


def test_a_cluster(hide, refused, tmp_path):
    hide("distributed")
    line = "--scheduler needs distributed: pip install -e '.[cluster]' in the clone"
    assert refused("reproduce", "--quick", "--scheduler", "tcp://127.0.0.1:9") == line
    assert not list(tmp_path.iterdir())
    with pytest.raises(InputError, match=re.escape(line)):
        DaskCluster("tcp://127.0.0.1:9")


NOTE = "note: no energy of trainings is measured: pip install -e '.[emissions]' in the clone"


@pytest.mark.parametrize("group", ["trained", "baseline"])
@pytest.mark.parametrize("hidden", [EXTRAS["emissions"], ()], ids=["missing", "there"])
def test_energy_is_not_needed_but_its_lack_is_noted(hide, iout, monkeypatch, hidden, group):
    def run_study(*_, **__):
        raise InputError("it would run now")

    monkeypatch.setattr("iout_marl.study.run.run_study", run_study)
    hide(*hidden)
    study = {"title": "Tiny", "groups": {group: tiny_study.STUDY["groups"][group]}}
    Path("tiny.yaml").write_text(json.dumps(study))
    _, _, err = iout("reproduce", "--study", "tiny.yaml", "--jobs", 1)
    told = [NOTE] if hidden and group == "trained" else []
    assert err.splitlines() == [*told, "iout: it would run now"]


def test_no_more_than_the_first_is_named():
    assert missing("report") == ""
    require("this", "report", "matplotlib")
    with pytest.raises(
        InputError, match=r"^this needs no_such: pip install -e '.\[x\]' in the clone"
    ):
        require("this", "x", "no_such", "no_other")


def run(program, folder):
    """A program in a process of its own, in which all that extras bring is hidden."""
    hidden = f"import sys\nfor name in {HIDDEN!r}:\n    sys.modules[name] = None\n"
    command = [sys.executable, "-c", hidden + program]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.slow
def test_all_else_needs_no_extra(tmp_path, tiny_settings):
    program = f"""
from iout_marl import cli
settings = {tiny_settings!r}
play = ["--episodes", "1", "--json", "-"]
for words in (
    ["scenarios"],
    ["new", "mine.yaml", "--from", "best/k3-fdd"],
    ["train", "mine.yaml", *settings, "--steps", "80", "--out", "run"],
    ["evaluate", "mine.yaml", *settings, "--policy", "run", "--policy", "tour", *play],
    ["bound", "mine.yaml", *settings, "--seconds", "0"],
):
    try:
        cli.main(words)
    except SystemExit as ended:
        assert not ended.code, words
"""
    done = run(program, tmp_path)
    assert done.returncode == 0, done.stderr[-500:]
    assert (tmp_path / "run/policy.safetensors").exists()


@pytest.mark.slow
@pytest.mark.parametrize("how", ["import iout_marl", "iout --help", "Trainer"])
def test_nothing_heavy_is_imported_to_begin_with(how, tmp_path):
    program, needed = {
        "import iout_marl": ("import iout_marl", set()),
        "iout --help": (
            "from iout_marl.cli import _run\nassert _run(['--help']) == (0, '')",
            set(),
        ),
        "Trainer": (
            "import iout_marl\niout_marl.Trainer('paper/k3-fdd').iterate()",
            {"torch", "trainers.ppo"},
        ),
    }[how]
    found = f"print('heavy', (set({HEAVY!r}) & sys.modules.keys()) - {needed or 'set()'})"
    command = [sys.executable, "-c", f"import sys\n{program}\n{found}"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "heavy set()"
