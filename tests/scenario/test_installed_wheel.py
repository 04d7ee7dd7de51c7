"""What a user gets by pip: both packages, the scenarios within, nothing heavy on import."""

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from iout_marl import bundled_names, load_scenario

REPOSITORY = Path(__file__).parents[2]
PROGRAM = """
import json, sys
import iout_marl
heavy = sorted({"torch", "matplotlib", "tensorboard", "trainers.ppo"} & set(sys.modules))
import trainers
from iout_marl import bundled_names, load_scenario
print(json.dumps({
    "from": [iout_marl.__file__, trainers.__file__],
    "heavy": heavy,
    "hashes": {name: load_scenario(name).hash for name in bundled_names()},
    "paper": load_scenario("paper/k3-fdd", ["training.preset=paper"]).training.epochs,
}))
"""


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--disable-pip-version-check"]
    options = ["--no-deps", "--no-build-isolation", "--no-index", "--wheel-dir", str(folder)]
    subprocess.run([*command, *options, str(REPOSITORY)], check=True)
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    return folder / "site"


@pytest.fixture(scope="module")
def seen(unpacked):
    """What a program elsewhere sees of the wheel."""
    printed = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        cwd=unpacked.parent,
        env={**os.environ, "PYTHONPATH": str(unpacked)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert not printed.stderr
    return json.loads(printed.stdout)


@pytest.mark.slow
def test_both_packages_come_from_the_wheel(unpacked, seen):
    assert all(Path(file).is_relative_to(unpacked) for file in seen["from"])


@pytest.mark.slow
def test_bundled_scenarios_are_found_and_the_same(seen):
    assert seen["hashes"] == {name: load_scenario(name).hash for name in bundled_names()}


@pytest.mark.slow
def test_presets_are_found(seen):
    assert seen["paper"] == 10


def test_import_brings_in_nothing_heavy(seen):
    assert seen["heavy"] == []


def test_wheel_holds_the_packages_and_nothing_else(unpacked):
    top = {path.name for path in unpacked.iterdir()}
    assert {"iout_marl", "trainers"} <= top
    assert all(name in ("iout_marl", "trainers") or name.endswith(".dist-info") for name in top)


def test_types_are_marked_as_such(unpacked):
    assert (unpacked / "iout_marl/py.typed").is_file()
    assert (unpacked / "trainers/py.typed").is_file()


@pytest.mark.slow
def test_all_that_lies_with_the_scenarios_is_in_the_wheel(unpacked):
    def files(folder):
        return {path.relative_to(folder) for path in folder.rglob("*") if path.is_file()}

    assert files(unpacked / "iout_marl/_scenarios") == files(REPOSITORY / "scenarios")
