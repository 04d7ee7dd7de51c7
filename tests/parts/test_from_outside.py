"""Parts of a user's own: imported by name or file, hashed, saved, missed, refused."""

import json
import os
import pickle
import re
import subprocess
import sys
from pathlib import Path

import forked
import pytest
from tiny_study import TINY, write_study

from iout_marl import (
    InputError,
    Trainer,
    World,
    evaluate,
    load_policy,
    load_scenario,
    outside,
    parts,
)
from iout_marl.scenario import to_yaml
from iout_marl.study.pools import LocalProcesses

MINE = '''
from iout_marl import metrics, parts

@parts.rewards.register("peak_age", version={version})
class PeakAge(parts.Reward):
    """The highest age."""

    class Settings(parts.Settings):
        weight: parts.Positive = 1.0

    def __call__(self, state, events):
        worst = self.xp.max(state.age, axis=-1, keepdims=True)
        return {{"age": -self.settings.weight * worst}}

@parts.motions.register("diagonal", version=1)
class Diagonal(parts.Motion):
    """Along two axes at once."""

    steps = ((1, 1, 0), (-1, -1, 0), (1, -1, 0), (-1, 1, 0))

@metrics.register("oldest_now", unit="slots", definition="The highest age now.")
def oldest_now(world, state):
    return world.backend.xp.max(state.age, axis=-1)
'''


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch, forgotten_parts, forgotten_metrics):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "adir").mkdir()
    (tmp_path / "my_parts.py").write_text(MINE.format(version=1))
    settings = {**TINY, "reward": {"kind": "peak_age", "weight": 2.0}, "auvs.motion": "diagonal"}
    lines = [f"{key}: {json.dumps(value)}" for key, value in nested(settings).items()]
    (tmp_path / "mine.yaml").write_text("extends: best/k3-fdd\n" + "\n".join(lines) + "\n")


def nested(flat):
    """Dotted keys as mappings within mappings."""
    whole = {}
    for dotted, value in flat.items():
        *path, last = dotted.split(".")
        place = whole
        for key in path:
            place = place.setdefault(key, {})
        place[last] = value
    return whole


@pytest.mark.parametrize("source", ["my_parts", "my_parts.py", "./my_parts.py"])
def test_a_scenario_names_what_an_import_brings(iout, source):
    status, out, _ = iout("show", "mine.yaml", "--import", source)
    assert status == 0
    assert "kind: peak_age\n  weight: 2.0" in out
    assert "motion: diagonal" in out


def test_without_the_import_its_kind_is_unknown(refused):
    line = refused("show", "mine.yaml", "--set", "auvs.motion=six")
    assert re.fullmatch(
        r"mine\.yaml:\d+: reward\.kind: unknown kind 'peak_age'.* known: .*paper.*; "
        "parts from outside need --import",
        line,
    )


def test_a_slip_in_its_name_or_its_keys_is_told(refused):
    outside.bring_in("my_parts")
    line = refused("show", "mine.yaml", "--set", "reward.kind=peek_age")
    assert "unknown kind 'peek_age'; did you mean 'peak_age'? known: " in line
    assert "reward.weight: must be greater than 0" in refused(
        "show", "mine.yaml", "--set", "reward.weight=-1"
    )
    assert "did you mean 'weight'?" in refused("show", "mine.yaml", "--set", "reward.wieght=1")
    assert "auvs.motion: unknown kind 'diagnal'; did you mean 'diagonal'?" in refused(
        "show", "mine.yaml", "--set", "auvs.motion=diagnal"
    )


def registering(what, base="Reward"):
    """A module that registers a part."""
    decorated = f"@parts.rewards.register({what})\nclass Mine(parts.{base}): pass"
    return f"from iout_marl import parts\n{decorated}"


WRONG = {
    "no module": ("nowhere", None, "--import: there is no module 'nowhere'"),
    "folder": ("adir", None, "--import: adir: is a folder, not a module or a file"),
    "folder's path": ("./adir", None, "--import: ./adir: is a folder, not a module or a file"),
    "no file": ("nowhere.py", None, "--import: there is no file 'nowhere.py'"),
    "slip": ("my_part", None, "there is no module 'my_part'; did you mean 'my_parts'?"),
    "error": ("broken.py", "1/0", "broken.py cannot be imported: .*broken.py:1: ZeroDivision"),
    "syntax": ("broken.py", "def", "--import: broken.py cannot be imported: .*broken.py:1: "),
    "no version": (
        "broken.py",
        registering("'mine'"),
        r"reward 'mine': Mine must state a version: register\(\"mine\", version=1\)",
    ),
    "taken": (
        "broken.py",
        registering("'paper', version=1"),
        "reward 'paper': .*Mine has the name of iout_marl.*Paper: two parts of one kind",
    ),
    "no word": (
        "broken.py",
        registering("'my reward', version=1"),
        "a kind is a word of lower-case letters",
    ),
    "another role": (
        "broken.py",
        registering("'mine', version=1", "Motion"),
        "Mine must be a class that extends Reward",
    ),
    "no version's type": (
        "broken.py",
        registering("'mine', version=1.5"),
        "version must be a whole number or a text, not 1.5",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_cannot_be_imported(tmp_path, refused, case):
    source, contents, expected = WRONG[case]
    if contents is not None:
        (tmp_path / source).write_text(contents)
    assert re.search(expected, refused("show", "paper/k3-fdd", "--import", source))


def test_settings_and_versions_are_in_the_hash(tmp_path):
    outside.bring_in("my_parts")
    one, other = (load_scenario("mine.yaml", {"reward.weight": w}) for w in (2.0, 3.0))
    assert len({one.hash, other.hash}) == 2
    assert one.world_hash == other.world_hash
    assert load_scenario("mine.yaml", {"auvs.motion": "six"}).world_hash != one.world_hash
    parts.rewards.unregister("peak_age")
    (tmp_path / "newer.py").write_text(MINE.format(version=2).partition("@parts.motions")[0])
    outside.bring_in("newer.py")
    newer = load_scenario("mine.yaml")
    assert newer.hash != one.hash
    assert newer.world_hash == one.world_hash


def test_settings_survive_yaml_pickle_and_scenario():
    outside.bring_in("my_parts")
    scenario = load_scenario("mine.yaml")
    Path("whole.yaml").write_text(to_yaml(scenario))
    copies = load_scenario("whole.yaml"), pickle.loads(pickle.dumps(scenario))
    for again in (*copies, load_scenario(scenario)):
        assert again.hash == scenario.hash
        assert again.reward == scenario.reward
        assert again.reward.weight == 2.0


def steps_of(scenario):
    """What another process finds."""
    return World(scenario).motion.steps.tolist(), scenario.reward.weight


@pytest.mark.slow
@pytest.mark.parametrize("source", ["my_parts", "my_parts.py"])
def test_a_scenario_that_is_pickled_brings_its_parts_along(source):
    outside.bring_in(source)
    scenario = load_scenario("mine.yaml")
    with LocalProcesses.context.Pool(1) as pool:
        assert pool.apply(steps_of, (scenario,)) == steps_of(scenario)


@pytest.mark.slow
def test_a_run_says_which_import_is_missing(iout, tmp_path):
    words = ["train", "mine.yaml", "--import", "my_parts.py", "--out", "run", "--steps", "240"]
    status, out, err = iout(*words)
    assert (status, err.count("Traceback")) == (0, 0), err
    assert "oldest now" in out.lower() or "oldest_now" in out
    path = tmp_path / "my_parts.py"
    stated = json.loads((tmp_path / "run" / "policy.json").read_text())["parts"]
    assert {(p["role"], p["kind"], p["version"]) for p in stated} == {
        ("reward", "peak_age", 1),
        ("motion", "diagonal", 1),
    }
    evaluate = ["evaluate", "mine.yaml", "--policy", "run", "--episodes", "2"]
    assert iout(*evaluate, "--import", "my_parts.py")[0] == 0
    found = forked.run("evaluate", "paper/k3-fdd", "--policy", "run", "--transfer")
    assert (found.returncode, found.stdout) == (2, "")
    assert found.stderr == (
        "iout: run: was trained with motion 'diagonal' of version 1, which is not registered: "
        f"give --import {path}\n"
    )
    parts.rewards.unregister("peak_age")
    parts.rewards.register("peak_age", version=7)(type("Newer", (parts.rewards["paper"].item,), {}))
    with pytest.raises(InputError, match="of version 1; the one registered here is of version 7"):
        load_policy("run")


@pytest.mark.slow
def test_a_study_takes_its_imports_to_its_workers(iout, tmp_path):
    group = {
        "scenarios": ["mine.yaml"],
        "policies": ["greedy", "ppo"],
        "seeds": [0],
        "episodes": 2,
        "series": "{policy}",
    }
    write_study(tmp_path / "study.yaml", groups={"g": group}, quick={})
    words = ["reproduce", "--study", "study.yaml", "--out", "out", "--jobs", "1"]
    status, _, err = iout(*words, "--import", "my_parts.py")
    assert status == 0, err
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert all("oldest_now" in str(cell) for cell in results["cells"])
    line = forked.run(*words)
    assert line.returncode == 2
    assert "unknown kind" in line.stderr


@pytest.mark.slow
def test_an_entry_point_brings_parts(tmp_path):
    info = tmp_path / "site" / "others-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: others\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[iout_marl.parts]\nmine = others_parts\nbroken = not_there\n"
    )
    (tmp_path / "site" / "others_parts.py").write_text(MINE.format(version=1))
    found = subprocess.run(
        [sys.executable, "-m", "iout_marl", "show", "mine.yaml"],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path / "site"), *sys.path])},
    )
    assert found.returncode == 0, found.stderr
    assert "kind: peak_age" in found.stdout
    assert "others: entry point iout_marl.parts: not_there cannot be imported" in found.stderr


@pytest.mark.slow
def test_a_folder_of_the_users_does_not_stand_in_for_ours(tmp_path):
    (tmp_path / "trainers").mkdir()
    (tmp_path / "trainers" / "__init__.py").write_text("raise SystemExit('not this one')")
    words = ["train", "mine.yaml", "--import", "my_parts", "--out", "run", "--steps", "240"]
    command = [sys.executable, "-m", "iout_marl", *words]
    found = subprocess.run(command, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stderr


def test_no_file_makes_code_run(tmp_path, refused):
    (tmp_path / "evil.py").write_text("open('ran', 'w').close()")
    (tmp_path / "evil.yaml").write_text("extends: paper/k3-fdd\nimport: evil\n")
    assert "import: unknown key" in refused("show", "evil.yaml")
    assert not (tmp_path / "ran").exists()


@pytest.mark.usefixtures("forgotten_parts")
@pytest.mark.parametrize(
    ("annotation", "value"),
    [(dict[str, float], {"a": 1.0}), (list[int], [1, 2]), (dict[str, list[int]], {"a": [1]})],
    ids=["a mapping", "a list", "lists in a mapping"],
)
def test_settings_of_any_type_can_be_trained_with(tiny, annotation, value):
    @parts.rewards.register("of_any_type", version=1)
    class OfAnyType(parts.Reward):
        class Settings(parts.Settings):
            value: annotation

        def __call__(self, state, events):
            return {"age": -self.xp.max(state.age, axis=-1, keepdims=True)}

    scenario = tiny({"reward": {"kind": "of_any_type", "value": value}})
    assert hash(scenario) == hash(load_scenario(scenario.model_dump()))
    assert scenario == load_scenario(scenario.model_dump())
    Trainer(scenario).iterate()


@pytest.mark.parametrize(
    ("registry", "lacking"),
    [
        (parts.rewards, "__call__"),
        (parts.duplexes, "charging_frequency_khz, uplink_frequency_khz, split, sends"),
        (parts.placements, "num_nodes, draw"),
        (parts.networks, "make_actor, make_critic"),
    ],
    ids=lambda each: getattr(each, "role", None),
)
def test_parts_that_lack_what_all_must_have_are_not_registered(registry, lacking):
    bare = type("Bare", (registry.base,), {})
    with pytest.raises(InputError, match=f"^{registry.role} 'bare': must have {lacking}$"):
        registry.register("bare", version=1)(bare)


@pytest.mark.parametrize(
    ("registry", "members", "place", "lacking"),
    [
        (parts.fadings, {"is_active": True, "most_db": 1.0}, "channel.fading", "gain_db"),
        (parts.currents, {}, "current", "frames"),
        (parts.motions, {}, "auvs.motion", "steps"),
    ],
    ids=lambda each: getattr(each, "role", None),
)
def test_parts_that_lack_what_is_asked_of_them_alone(registry, members, place, lacking):
    registry.register("bare", version=1)(type("Bare", (registry.base,), members))
    with pytest.raises(InputError, match=f"{registry.role} 'bare': must have {lacking}$"):
        evaluate("sea/bay", "random-walk", 1, overrides={place: "bare"})
