"""Policies of one's own by MODULE:NAME and FILE.py:NAME: found, played, or refused in one line."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from iout_marl import InputError, evaluate, iout_v0, load_policy, record_episode
from iout_marl.outside import import_module, import_named
from iout_marl.policies import Greedy

ROOT = Path(__file__).parents[2]
#: A class, an object, a function, and what is none of them.
CODE = '''
import dataclasses
import numpy as np

RUNS = []
RUNS.append(__name__)

@dataclasses.dataclass
class Still:
    """Charges and hears the first node."""
    name: str = "still"
    is_deterministic = True

    def act(self, world, state, rng):
        return np.zeros((world.num_envs, world.num_auvs, len(world.action_sizes)), dtype=int)

class Called:
    def __call__(self, observation):
        return function(observation)

class Kind:
    Inner = Still

class Wants:
    name = "wants"
    def __init__(self, more):
        pass
    def act(self, world, state, rng):
        pass

class Nameless:
    def act(self, world, state, rng):
        pass

class Breaks:
    name = "breaks"
    def act(self, world, state, rng):
        return 1 / 0

def breaks(observation):
    return 1 / 0

still = Still()

def function(observation):
    return np.zeros((*observation.shape[:-1], 3), dtype=int)

number = 3
'''
BROKEN = {
    "syntax": ("x = 1\ndef f(:\n", "syntax.py:2: invalid syntax"),
    "raises": ("\n\nraise RuntimeError('not\\ntoday')\n", "raises.py:3: RuntimeError: not"),
    "wanting": ("import nowhere_to_be_found\n", "wanting.py:1: ModuleNotFoundError: No module"),
    "exits": ("import sys\nsys.exit('enough')\n", "exits.py:2: SystemExit: enough"),
    "deep": ("def f():\n    return 1 / 0\n\nf()\n", "deep.py:2: ZeroDivisionError"),
}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A working folder with modules of a user's; all that they leave behind is taken away."""
    (tmp_path / "mine_of_tests.py").write_text(CODE)
    for name, (code, _) in BROKEN.items():
        (tmp_path / f"{name}_of_tests.py").write_text(code)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", sys.path[:])
    before = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - before:
        if "of_tests" in name:
            del sys.modules[name]


@pytest.mark.slow
@pytest.mark.parametrize("place", ["mine_of_tests", "mine_of_tests.py", "./mine_of_tests.py"])
@pytest.mark.parametrize("name", ["Still", "still", "Kind.Inner"])
def test_found_and_played(place, name):
    found = evaluate("paper/k3-fdd", f"{place}:{name}")
    assert (found.policy, found.episodes) == ("still", 1)
    assert found.to_json() == evaluate("paper/k3-fdd", load_policy(f"{place}:{name}")).to_json()
    assert len(record_episode("paper/k3-fdd", f"{place}:{name}").ages) == 100


@pytest.mark.parametrize("name", ["function", "Called"])
def test_functions_of_observations(name):
    found = evaluate("paper/k3-fdd", f"mine_of_tests:{name}", 1)
    still = evaluate("paper/k3-fdd", "mine_of_tests:still", 1)
    assert found.samples["mean_aoi"] == still.samples["mean_aoi"]


def test_files_anywhere_run_once(folder, monkeypatch):
    (folder / "other").mkdir()
    monkeypatch.chdir(folder / "other")
    modules = {
        id(import_module(path))
        for path in ("../mine_of_tests.py", str(folder / "mine_of_tests.py"), "../mine_of_tests.py")
    }
    assert len(modules) == 1
    assert len(import_named("../mine_of_tests.py:RUNS")) == 1
    monkeypatch.setenv("HOME", str(folder))
    assert id(import_module("~/mine_of_tests.py")) in modules


def test_files_import_what_lies_beside_them(folder, monkeypatch):
    (folder / "sub").mkdir()
    (folder / "sub" / "policy_of_tests.py").write_text("from beside_of_tests import name")
    (folder / "sub" / "beside_of_tests.py").write_text("name = 'beside'")
    assert import_named("sub/policy_of_tests.py:name") == "beside"


def test_the_working_folder_is_looked_through_last(folder):
    (folder / "trainers").mkdir()
    (folder / "trainers" / "__init__.py").write_text("raise RuntimeError('mine')")
    (folder / "json.py").write_text("raise RuntimeError('mine')")
    assert import_named("trainers:Trainer").__module__ == "trainers.ppo"
    assert import_named("json:dumps") is json.dumps
    assert sys.path[-1] == str(folder)
    assert sys.path.count(str(folder)) == 1
    import_named("mine_of_tests:still")
    assert sys.path.count(str(folder)) == 1


def test_a_module_is_not_meant(folder):
    with pytest.raises(InputError, match=r"mine_of_tests\.py has no 'dataclass'$"):
        import_named("mine_of_tests.py:dataclass")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("mine_of_test:Still", "there is no module 'mine_of_test'; did you mean 'mine_of_tests'?"),
        ("nowhere.at.all:x", "there is no module 'nowhere.at.all'"),
        ("mine_of_tests.inner:x", "there is no module 'mine_of_tests.inner'"),
        ("mine_of_test.py:Still", "there is no file 'mine_of_test.py'"),
        (".py:Still", "there is no file '.py'"),
        ("mine_of_tests:Stil", "mine_of_tests.py, has no 'Stil'; did you mean 'Still'?"),
        ("mine_of_tests.py:Stil", "mine_of_tests.py has no 'Stil'; did you mean 'Still'?"),
        ("mine_of_tests:", "must be of the form MODULE:NAME or FILE.py:NAME"),
        (":Still", "must be of the form MODULE:NAME or FILE.py:NAME"),
        ("mine_of_tests:a b", "must be of the form MODULE:NAME or FILE.py:NAME"),
        ("mine_of_tests:number", "a policy needs a name and a method act, or must be callable"),
        ("mine_of_tests:Nameless", "a policy needs a name and a method act, or must be callable"),
        ("mine_of_tests:Wants", "Wants() cannot be made: TypeError: "),
        (".relative:x", "cannot be imported: TypeError"),
        ("mine_of_tests.py", "is a file, not the folder of a run; a policy in it is mine_of_"),
    ],
)
def test_refused(refused, name, expected):
    with pytest.raises(InputError) as raised:
        load_policy(name)
    assert str(raised.value).startswith(f"policy {name}: ")
    assert expected in str(raised.value)
    for command in (["evaluate"], ["bound"], ["evaluate", "--policy", "planner"]):
        option = "--planner-start" if len(command) > 1 else "--policy"
        line = refused(*command, "paper/k3-fdd", option, name)
        assert line == str(raised.value).replace("policy", option, 1)


@pytest.mark.slow
@pytest.mark.parametrize("name", BROKEN)
@pytest.mark.parametrize("suffix", ["", ".py"])
def test_what_fails_while_it_is_imported(refused, name, suffix):
    place = f"{name}_of_tests{suffix}"
    _, expected = BROKEN[name]
    for _ in range(2):
        line = refused("evaluate", "paper/k3-fdd", "--policy", f"{place}:x")
        assert line.startswith(f"--policy {place}:x: {place} cannot be imported: ")
        assert expected.replace(".py", "_of_tests.py") in line


@pytest.mark.slow
@pytest.mark.parametrize("name", ["Breaks", "breaks"])
def test_what_fails_while_it_plays(refused, name):
    place = f"mine_of_tests.py:{name}"
    told = r"policy breaks: raises ZeroDivisionError: division by zero \(.*mine_of_tests\.py:\d+\)"
    for words in (["evaluate"], ["bound", "--seconds", 0], ["replay"]):
        line = refused(words[0], "paper/k3-fdd", *words[1:], "--policy", place)
        assert re.fullmatch(told, line)
    env = iout_v0.parallel_env("paper/k3-fdd")
    observations, _ = env.reset(seed=0)
    with pytest.raises(InputError, match=told):
        load_policy(place).predict(observations, env=env)
    setting = f"training.imitate={place}"
    line = refused("train", "paper/k3-fdd", "--set", setting, "--out", "run")
    assert re.fullmatch(f"--set {re.escape(setting)}: training.imitate: {told}", line)


def test_errors_of_the_packages_own_policies_are_no_fault_of_a_users(monkeypatch):
    monkeypatch.setattr(Greedy, "act", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        evaluate("paper/k3-fdd", "greedy", 1)


def test_ctrl_c_passes(folder):
    (folder / "stops_of_tests.py").write_text("raise KeyboardInterrupt")
    for name in ("stops_of_tests:x", "stops_of_tests.py:x"):
        with pytest.raises(KeyboardInterrupt):
            load_policy(name)


@pytest.mark.slow
@pytest.mark.parametrize("place", ["mine_of_tests", "mine_of_tests.py"])
def test_on_the_command_line(iout, place):
    words = ["--episodes", 2, "--policy", f"{place}:Still", "--policy", "greedy", "--json", "-"]
    status, out, _ = iout("evaluate", "paper/k3-fdd", *words)
    assert status == 0
    still, greedy = json.loads(out)
    assert (still["policy"], still["episodes"], greedy["policy"]) == ("still", 1, "greedy")
    words = ["--policy", f"{place}:Still", "--seconds", 0, "--json", "-"]
    status, out, _ = iout("bound", "paper/k3-fdd", *words)
    assert status == 0
    assert json.loads(out)["policies"][f"{place}:Still"]["episodes"] == 1


# What `python -c` is given stands for the script `iout`: by -P the working folder is not looked
# through at all.
ENTRIES = {
    "python -m iout_marl": ["-m", "iout_marl"],
    "iout": ["-P", "-c", "from iout_marl.cli import main; main()"],
}


@pytest.mark.slow
def test_no_folder_of_a_users_stands_in_for_ours(folder):
    """Not even under `python -m`, which puts the working folder first; training imports ours."""
    (folder / "trainers").mkdir()
    (folder / "trainers" / "__init__.py").write_text("raise RuntimeError('mine')")
    (folder / "typer.py").write_text("raise RuntimeError('mine')")
    settings = ("training.environments=1", "training.minibatches=1", "training.steps=1")
    words = [word for setting in settings for word in ("--set", setting)]
    train = [*("train", "paper/k3-fdd", "--out", "run"), *words]
    play = ["evaluate", "paper/k3-fdd", "--policy", "run", "--policy", "mine_of_tests:Still"]
    play += [*words, "--episodes", "1", "--json", "-"]
    for entry, command in (("python -m iout_marl", train), *((entry, play) for entry in ENTRIES)):
        ran = subprocess.run(
            [sys.executable, *ENTRIES[entry], *command],
            capture_output=True,
            text=True,
            env={"PYTHONPATH": str(ROOT), "PATH": ""},
            check=False,
        )
        assert ran.returncode == 0, ran.stderr
        if command is play:
            assert [each["policy"] for each in json.loads(ran.stdout)] == ["run", "still"], entry
