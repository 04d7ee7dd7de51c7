"""`iout mission`: what it writes, and that it writes all or nothing."""

import sys
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from iout_marl import InputError, files, load_scenario
from iout_marl.mission import FORMATS, Place, Route, format_named, plan_mission, write_mission
from iout_marl.scenario.sections import Grid, Origin

HERE = {"latitude_deg": 41.18, "longitude_deg": -8.7, "depth_m": 5}
ORIGIN = f"grid.origin={HERE}"
PLACED = ("--set", ORIGIN, "--set", "episode.duration_s=200")
WORDS = ("mission", "paper/k3-fdd", "--policy", "greedy", "--out", "m")


def names(folder):
    return {path.name for path in Path(folder).iterdir()}


@pytest.fixture(autouse=True)
def _working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_every_auv_gets_a_file_of_every_format(iout):
    formats = [word for name in FORMATS for word in ("--format", name)]
    status, out, err = iout(
        *WORDS, *formats, *PLACED, "--set", "auvs.count=2", "--start-time", "2027-05-01T10:00+02:00"
    )
    assert (status, err) == (0, "")
    assert out.splitlines()[0] == (
        "m: 18 files written: 2 AUVs, 2027-05-01T08:00:00.000Z to 2027-05-01T08:03:20.000Z"
    )
    expected = {f"auv-{i}{each.suffix}" for i in (1, 2) for each in FORMATS.values()}
    assert names("m") == expected | {"actions.csv", "actions.json"}


def test_a_run_goes_where_its_scenario_is_put_on_earth(iout, refused, tiny_settings):
    assert iout("train", "best/k3-fdd", *tiny_settings, "--steps", 80, "--out", "run")[0] == 0
    own = ("mission", "best/k3-fdd", "--policy", "run", "--format", "kml", *tiny_settings)
    assert iout(*own, "--set", ORIGIN, "--out", "deep/m")[0] == 0
    assert Path("deep/m/auv-1.kml").is_file()
    other = (*own, "--set", ORIGIN, "--set", "grid.spacing_m=90", "--out", "n")
    assert refused(*other).startswith("run: was trained on another scenario, best/k3-fdd")
    assert iout(*other, "--transfer", "--sampled")[0] == 0


@pytest.mark.parametrize("name", [f.name for f in FORMATS.values() if f.needs_origin])
def test_an_origin_is_needed_where_things_are_on_earth(refused, name):
    assert refused(*WORDS, "--format", name).startswith(
        f"--format {name}: needs grid.origin, where cell (1, 1, 1) lies on Earth, which "
        "paper/k3-fdd does not say: --set 'grid.origin={latitude_deg: …"
    )
    assert not Path("m").exists()


def test_local_metres_need_none(iout):
    assert iout(*WORDS, "--format", "moos", "--format", "csv", "--start-time", "2027-05-01")[0] == 0
    first = Path("m/auv-1.csv").read_text().splitlines()[1]
    assert first == "1,1,0.0,2027-05-01T00:00:00.000Z,0.0,0.0,400.0,400.0,100.0,,"
    assert "nowhere on Earth" in Path("m/auv-1.bhv").read_text()


@pytest.mark.parametrize("there", ["auv-1.kml", "actions.csv"])
def test_nothing_is_written_over(refused, there):
    Path("m").mkdir()
    Path("m", there).write_text("mine")
    line = refused(*WORDS, *PLACED, "--format", "kml")
    assert line == f"m/{there}: is there already, and is not written over: name another folder"
    assert names("m") == {there}
    assert Path("m", there).read_text() == "mine"


def test_nothing_is_written_where_something_fails(refused, monkeypatch):
    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(files.os, "fsync", full)
    line = refused(*WORDS[:-1], "new/m", *PLACED, "--format", "kml", "--format", "csv")
    assert line == "new/m/auv-1.kml: cannot be written: No space left on device"
    assert not names(".")
    Path("file").write_text("")
    line = refused(*WORDS[:-1], "file/m", *PLACED, "--format", "csv")
    assert line == "file/m: cannot be written: Not a directory"


def test_nothing_is_left_of_a_mission_that_is_interrupted(iout, monkeypatch):
    real, calls = Path.replace, []

    def interrupted(path, target):
        calls.append(path)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return real(path, target)

    monkeypatch.setattr(Path, "replace", interrupted)
    assert iout(*WORDS[:-1], "new/m", *PLACED, "--format", "csv")[0] == 130
    assert not names(".")


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--format", "kmz"], "unknown format 'kmz'; did you mean 'kml'?"),
        (
            ["--format", "kml", "--start-time", "noon"],
            "must be a time in UTC such as 2027-05-01T08:00:00Z, not 'noon'",
        ),
        (
            ["--format", "csv", "--start-time", "9999-12-31T23:59:59"],
            "9999-12-31: the mission would not lie within the years 1 to 9999",
        ),
        (["--format", "csv", "--policy", "gredy"], "did you mean 'greedy'?"),
        (["--format", "csv", "--sampled"], "--sampled: the policy is no trained one"),
        (["--format", "csv", "--seed", "-1"], "must be at least 0"),
        ([], "Missing option '--format'"),
    ],
    ids=["format", "time", "year", "policy", "sampled", "seed", "no-format"],
)
def test_bad_options(refused, words, line):
    assert line in refused(*WORDS, *PLACED, *words)
    assert not Path("m").exists()


@pytest.mark.parametrize("name", ["kml", "csv"])
def test_the_library_is_asked_for_before_anything_is_played(refused, monkeypatch, name):
    monkeypatch.setitem(sys.modules, "pyproj", None)
    line = refused(*WORDS, *PLACED, "--format", name)
    assert line.endswith("needs pyproj: pip install -e '.[mission]' in the clone")
    assert not Path("m").exists()


@pytest.mark.slow
@pytest.mark.parametrize("name", [f.name for f in FORMATS.values() if not f.has_times])
def test_arrivals_that_would_not_hold_are_refused(name, tmp_path):
    """A thousand kilometres from the origin straight lines of the grid are longer on Earth."""
    mission = plan_mission("paper/k3-fdd", "tour", 0)
    place = Place(Grid(cells=(1000, 1000, 1), spacing_m=1000.0, origin=Origin.model_validate(HERE)))
    path = np.array([(900, 900 + i, 1) for i in range(40)])
    route = Route.from_path(1, path, place, 250.0)
    mission = replace(mission, place=place, routes=(route,), actions=mission.actions[:1])
    if name == "moos":  # whose metres are those of the grid
        write_mission(mission, [format_named(name)], tmp_path)
        return
    with pytest.raises(
        InputError, match=r"^AUV 1: would be [\d.]+ s too (late|early) at waypoint 2"
    ):
        write_mission(mission, [format_named(name)], tmp_path / "m")
    assert not (tmp_path / "m").exists()


def test_names_of_users_do_no_harm(tmp_path):
    start = datetime(2027, 1, 1, tzinfo=UTC)
    changes = {"name": "a\n<b>&\x00 }\n", "episode.duration_s": 100}
    changes["grid.origin"] = {"latitude_deg": 1, "longitude_deg": 2}
    mission = plan_mission(load_scenario("paper/k3-fdd", changes), "greedy", 0, start)
    write_mission(mission, list(FORMATS.values()), tmp_path)
    for name in ("auv-1.kml", "auv-1.gpx"):
        assert r"AUV 1 of a\n<b>&\x00 }\n" in "".join(
            ET.parse(tmp_path / name).getroot().itertext()
        )
    assert (tmp_path / "auv-1.bhv").read_text().splitlines()[0].startswith(r"// AUV 1 of a\n<b>&")
