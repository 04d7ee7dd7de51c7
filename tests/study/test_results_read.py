"""What a file of results may say: all of it is checked, so that what is read can be reported."""

import copy
import json
import os
import shutil
from pathlib import Path

import pytest
from tiny_study import SameProcess, write_study

from iout_marl import InputError
from iout_marl.report.build import build_report
from iout_marl.report.markdown import render_markdown
from iout_marl.study import expand, load_study, run_study
from iout_marl.study.results import Measured, Record, read_record, read_results
from iout_marl.study.run import StudyFolder

#: A finished study as the first format had it: `tiny_study.STUDY`.
FORMAT_1 = Path(__file__).parent / "fixtures" / "format-1"
IDENTITY = {"name": "tiny", "title": "A tiny study", "overrides": [], "quick": False}
RESULTS = json.loads((FORMAT_1 / "results.json").read_text())
#: Index of a cell of a baseline, and of one that was trained.
PLAYED, TRAINED = 0, 2
#: What may be missing: it came later, or has a usual value.
MAY_BE_MISSING = {
    *("front", "failures", "search", "deterministic", "trained_in"),
    *("axis.key", "axis.label", "axis.variants"),
}


def told(path):
    """The line by which a file of results is refused."""
    with pytest.raises(InputError) as error:
        read_results(path)
    line = str(error.value)
    assert line.startswith(f"{path}: ")
    assert line.isprintable()
    return line


def written(folder, data):
    path = folder / "results.json"
    path.write_text(json.dumps(data))
    return path


def changed(keys, value):
    """The results with another value at a place; the place of its holder."""
    data = copy.deepcopy(RESULTS)
    holder = data
    for key in keys[:-1]:
        holder = holder[key]
    holder[keys[-1]] = value
    return data


def places(data, path=()):
    """Every key of a nested mapping, of lists those of the first item."""
    if isinstance(data, dict):
        for key, value in data.items():
            yield (*path, key)
            yield from places(value, (*path, key))
    elif isinstance(data, list) and data:
        yield from places(data[0], (*path, 0))


def test_results_and_folder_of_the_first_format_are_read_and_gone_on_with(tmp_path):
    shutil.copytree(FORMAT_1, tmp_path / "out")
    before = read_results(tmp_path / "out" / "results.json")
    study = load_study(write_study(tmp_path / "tiny.yaml"))
    folder = StudyFolder(tmp_path / "out")
    with folder.open(IDENTITY):
        again = run_study(
            *("tiny", study[0], expand(*study), folder, SameProcess(stop_after=0)),
            before.command,
        )
    assert again == before
    assert {
        len(c.record.samples["reward"]) for c in again.cells if c.record.policy == "greedy"
    } == {3}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"", "damaged, it is no JSON"),
        (b"{", "damaged, it is no JSON"),
        (b"[" * 100_000, "nested too deeply"),
        (b'{"format": ' + b'{"a":' * 100_000, "nested too deeply"),
        (b"\x00\xff\xfe\x80", "damaged, it is no JSON"),
        (b"[1, 2]", "no file of a study, or damaged: the numbers format and world_version"),
        (b'{"format": true, "world_version": false}', "no file of a study, or damaged"),
        (b'{"format": 2, "world_version": 0}', "format 2 and world version 0, not 1 and 0"),
        (b'{"format": NaN}', "NaN is no number of JSON"),
        (b'{"format": ' + b"9" * 5_000 + b"}", "damaged, it is no JSON"),
    ],
)
def test_a_file_that_is_none_is_told_in_one_line(tmp_path, text, message):
    path = tmp_path / "results.json"
    path.write_bytes(text)
    assert message in told(path)


@pytest.mark.posix
def test_a_folder_or_a_closed_file_in_its_place_is_told(tmp_path):
    path = tmp_path / "results.json"
    path.mkdir()
    assert "cannot be read: Is a directory" in told(path)
    path.rmdir()
    path.write_text("{}")
    path.chmod(0)
    if os.access(path, os.R_OK):
        pytest.skip("this user may read everything")
    assert "cannot be read: Permission denied" in told(path)


@pytest.mark.parametrize("place", sorted(set(places(RESULTS)), key=str), ids=str)
def test_every_key_that_is_missing_is_named(tmp_path, place):
    cell = TRAINED if place[:2] == ("cells", 0) else 0
    keys = [cell if i == 1 and place[0] == "cells" else key for i, key in enumerate(place)]
    data = copy.deepcopy(RESULTS)
    holder = data
    for key in keys[:-1]:
        if holder[key] is None:
            return  # of a part that this cell lacks
        holder = holder[key]
    if keys[-1] not in holder or keys[-2:-1] in (["settings"], ["machine"]):
        return
    del holder[keys[-1]]
    path = written(tmp_path, data)
    if {keys[-1], ".".join(map(str, keys))} & MAY_BE_MISSING:
        render_markdown(build_report(read_results(path)), "figures")
    elif keys[0] in ("format", "world_version"):
        assert keys[0] in told(path)
    else:
        assert str(keys[-1]) in told(path)


SAMPLES = ("cells", PLAYED, "record", "samples")
TRAINING = ("cells", TRAINED, "record", "training")
EPISODE = ("cells", TRAINED, "record", "episode")
MISTAKES = {
    "no such report": (
        ("report",),
        "papers",
        "report: unknown report 'papers'; did you mean 'paper'?",
    ),
    "infinite place": (("cells", 0, "axis"), float("inf"), "Infinity is no number of JSON"),
    "place beyond all": (("cells", 0, "axis"), 1e300, r"cells[0].axis: must be less than"),
    "place in words": (("cells", 0, "axis"), "3", "cells[0].axis: must be a valid number"),
    "place that is none": (("cells", 0, "axis"), None, "cells[0].axis"),
    "title with an escape": (("title",), "a\x1b[31mb", "title: must not hold the control char"),
    "title of two lines": (("title",), "a\nb", "title: must not hold the control character"),
    "half a character": (("cells", 0, "series"), "\ud800", "cells[0].series: must not hold"),
    "endless heading": (("axis", "label"), "K" * 2_000, "axis.label: must have at most 1,000"),
    "command with a bell": (("command",), "iout \x07", "command: must not hold the control"),
    "carbon below 0": (("carbon_g_per_kwh",), -1, "carbon_g_per_kwh: must be greater than"),
    "too few samples": ((*SAMPLES, "jain"), [1.0], "samples.jain: must hold a number for each"),
    "no samples": ((*SAMPLES, "mean_aoi"), [], "samples.mean_aoi: must hold a number for each"),
    "samples in words": ((*SAMPLES, "jain"), ["1", "1", "1"], "samples.jain[0]: must be a valid"),
    "samples of bools": ((*SAMPLES, "jain"), [True] * 3, "samples.jain[0]: must be a valid"),
    "huge samples": ((*SAMPLES, "reward"), [1e99] * 3, "samples.reward[0]: must be less than"),
    "unfair beyond all": ((*SAMPLES, "jain"), [2.0] * 3, "samples.jain: must lie between 0 and 1"),
    "ages of 0": ((*SAMPLES, "mean_aoi"), [0.0] * 3, "samples.mean_aoi: must lie above 0"),
    "energy below 0": ((*SAMPLES, "spent_kj"), [-1.0] * 3, "samples.spent_kj: must lie between"),
    "no episodes": (("cells", 0, "record", "episodes"), 0, "episodes: must be greater than"),
    "huge seed": (("cells", 0, "record", "seed"), 2**63, "seed: must be less than"),
    "policy of two kinds": (("cells", 0, "record", "policy"), ["a"], "policy: must be a valid"),
    "machine of numbers": (("cells", 0, "record", "machine"), {"cores": 2}, "machine.cores"),
    "curve of one length": ((*TRAINING, "curve", "env_steps"), [], "curve: has lists of different"),
    "curve of words": ((*TRAINING, "curve", "aoi/mean"), ["a"], "aoi/mean[0]: must be a valid"),
    "curve of nothing": ((*TRAINING, "curve", "aoi/mean"), [None], "aoi/mean[0]: must be a valid"),
    "curve that is a list": ((*TRAINING, "curve"), [1], "curve: must be a valid dictionary"),
    "no time": ((*TRAINING, "seconds"), 0, "training.seconds: must be greater than"),
    "half a step": ((*TRAINING, "env_steps"), 0.5, "training.env_steps: must be a valid integer"),
    "rate in words": (
        (*TRAINING, "settings", "learning_rate"),
        "x",
        "learning_rate: must be a num",
    ),
    "nested settings": ((*TRAINING, "settings", "clip"), {"a": 1}, "settings.clip: must be a num"),
    "energy of nothing": (
        (*TRAINING, "emissions"),
        {"energy_kwh": 0, "co2_kg": 0, "codecarbon": "3"},
        "emissions.energy_kwh: must be greater than",
    ),
    "grid of two": ((*EPISODE, "grid"), [3, 2], "episode.grid: List should have at least 3"),
    "cells of nothing": ((*EPISODE, "spacing_m"), 0, "episode.spacing_m[0]: must be greater than"),
    "node outside": ((*EPISODE, "nodes"), [[1, 1, 1], [9, 1, 1]], "episode.nodes: leaves the grid"),
    "a node too few": ((*EPISODE, "nodes"), [[1, 1, 1]], "episode"),
    "path of nowhere": ((*EPISODE, "path"), [], "episode.path: List should have at least 2"),
    "path of a slot": ((*EPISODE, "path"), [[[1, 1, 1]]] * 2, "episode.charged: must have 1 rows"),
    "ragged path": ((*EPISODE, "path", 3), [], "episode.path[3]: List should have at least 1"),
    "flat path": ((*EPISODE, "path", 3), [1, 1, 1], "episode.path[3][0]: must be a valid list"),
    "charged by name": ((*EPISODE, "charged", 0), ["a"], "episode.charged[0][0]: must be a valid"),
    "heard too many": ((*EPISODE, "heard", 0), [1, 1], "episode.heard: must have 20 rows of 1"),
    "heard beyond": ((*EPISODE, "heard", 0), [7], "episode.heard: names a node beyond the last, 2"),
    "charged below": ((*EPISODE, "charged", 0), [-1], "episode.charged[0][0]: must be greater"),
    "delivered a number": (
        (*EPISODE, "delivered", 0),
        [1],
        "delivered[0][0]: must be a valid bool",
    ),
    "ages of one": ((*EPISODE, "ages", 0), [1], "episode.ages: must have 20 rows of 2"),
    "ages below": ((*EPISODE, "ages", 0), [-0.5, 1], "ages[0][0]: must be greater"),
    "ages in words": ((*EPISODE, "ages", 0), ["a", 1], "ages[0][0]: must be a valid number"),
    "dock outside": ((*EPISODE, "docks"), [[9, 1, 1]], "episode.docks: leaves the grid"),
    "episode of words": (EPISODE, "none", "episode: must be a valid dictionary"),
    "another world's": (("cells", TRAINED, "record", "nodes"), 3, "must be of 3 nodes and 1 AUVs"),
    "failure of nobody": (("failures",), [{}], "failures[0].series: Field required"),
}


@pytest.mark.slow
@pytest.mark.parametrize(("keys", "value", "message"), MISTAKES.values(), ids=MISTAKES)
def test_a_value_that_is_none_is_named(tmp_path, keys, value, message):
    assert message in told(written(tmp_path, changed(keys, value)))


def test_a_series_of_bounds_and_of_policies_is_refused(tmp_path):
    data = copy.deepcopy(RESULTS)
    record = data["cells"][0]["record"]
    record |= {"policy": "bound", "samples": {"mean_aoi": record["samples"]["mean_aoi"]}}
    assert "cells[1].series: is a series of bounds and of policies" in told(written(tmp_path, data))


def test_markup_and_other_scripts_are_texts_like_others(tmp_path):
    data = copy.deepcopy(RESULTS)
    names = ["q[/lr]", "<b>|*`", "日本語", "مرحبا", "🐟", "=1+1"]
    for cell, name in zip(data["cells"], names, strict=True):
        cell["series"] = name
    results = read_results(written(tmp_path, data))
    assert results.series == names
    assert "日本語" in render_markdown(build_report(results), "figures")


@pytest.mark.parametrize("episodes", [1, 100])
def test_one_episode_or_a_hundred_that_are_alike_may_stand_for_a_deterministic_world(
    tmp_path, episodes
):
    data = copy.deepcopy(RESULTS)
    record = data["cells"][0]["record"]
    record |= {"episodes": episodes, "deterministic": episodes == 1}
    record["samples"] = {name: values[:1] * episodes for name, values in record["samples"].items()}
    results = read_results(written(tmp_path, data))
    estimate = results.measured("greedy", 1, "mean_aoi").estimate
    assert estimate.mean == 1
    assert (estimate.low == estimate.high == 1) == (episodes == 100)
    render_markdown(build_report(results), "figures")


def test_a_record_keeps_as_many_episodes_as_were_played(tmp_path):
    cell = expand(*load_study(write_study(tmp_path / "tiny.yaml")))[0]
    samples = {name: [1.0] for name in RESULTS["cells"][0]["record"]["samples"]}
    record = Record.from_cell(cell, samples, "2026-01-01", deterministic=True)
    assert (record.episodes, cell.episodes, record.deterministic) == (1, 3, True)
    assert record.key == cell.key
    assert Measured((1.0,), "episodes").estimate.mean == 1


def test_a_cell_of_another_key_or_kind_is_refused(tmp_path):
    source = next((FORMAT_1 / "cells").iterdir())
    with pytest.raises(InputError, match="it is of the cell"):
        read_record(source, "another")
    path = tmp_path / "cell.json"
    path.write_text(json.dumps({**json.loads(source.read_text()), "record": None}))
    with pytest.raises(InputError, match=r"cell\.json: cannot be read: all of it: must be a valid"):
        read_record(path, "another")
