"""Mutated studies, results, cells and markers: each is accepted, or refused in one line.

What is accepted must hold to the end: a study expands, results make a report.
"""

import copy
import json
import tempfile
import warnings
from functools import cache
from pathlib import Path

from tiny_study import STUDY

from campaigns.campaign import Campaign, Tally
from iout_marl import InputError
from iout_marl.files import parse_json
from iout_marl.report.build import build_report
from iout_marl.report.markdown import render_markdown
from iout_marl.report.plotly_writer import plotly_json
from iout_marl.report.writer import write_report
from iout_marl.study import expand, load_study
from iout_marl.study.results import read_record, read_results
from iout_marl.study.run import StudyFolder

TESTS = Path(__file__).parents[1]
FIXTURE = TESTS / "study" / "fixtures" / "format-1"
DOCS = TESTS.parent / "docs"
IDENTITY = {"name": "tiny", "title": "A tiny study", "overrides": [], "quick": False}
#: Of the reports that can be built, so many are drawn and written as well.
DRAWN = 0.02

#: Values of every type and size; `1e999` and `NaN` are what Python's own writer makes of them.
STRANGE = (
    *(None, True, False, 0, 1, -1, 7, 1000, 2**31, 2**63, 10**18, 10**25, 10**400),
    *(0.5, -0.0, 1e-320, 1e-30, 1e15, 1e49, 1e308, -1e308, float("inf"), float("nan")),
    *("", " ", "x", "greedy", "bound", "ppo", "paper", "nodes.count", "fast", "2026-01-01"),
    *("a\nb", "\x00", "\x1b[31m", "\ud800", "\u2028", "\ufffe", "A" * 5000, "1e6", "{policy}"),
    *("q[/lr]", "<script>", "`|*_#", "$\\alpha$", "%{x}", "&amp;", "日本語", "مرحبا", "🐟", "=1+1"),
    *([], {}, [[]], [None], [1, 2, 3], ["x"], [0] * 50, {"": {}}, {"x": 1}, {"kind": "none"}),
)


def run(rng, cases):
    """Play mutations of all four kinds of files."""
    tally = Tally()
    players = (play_study, play_results, play_record, play_marker)
    chosen = rng.choice(len(players), cases, p=(0.4, 0.4, 0.1, 0.1))
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("error")
        for number in chosen:
            players[number](rng, Path(folder), tally)
    return tally


def judge(tally, what, text, attempt):
    """Count what comes of a file that says `text`: `attempt` reads it and uses it."""
    try:
        outcome = attempt()
    except InputError as error:
        line = str(error)
        if line.isprintable() and len(line) < 5_000:
            tally.note(f"{what} refused")
        else:
            tally.fault((what, text), f"not one line: {line!r}")
    # Whatever else comes is what is looked for here.
    except Exception as error:
        tally.fault((what, text), error)
    else:
        tally.note(outcome)


def play_study(rng, folder, tally):
    """A study's file: it loads and expands."""
    path = folder / "study.yaml"
    text = mutated(rng, STUDY)
    path.write_bytes(text)

    def attempt():
        expand(*load_study(path), quick=bool(rng.random() < 0.3))
        return "studies accepted"

    judge(tally, "study", text, attempt)


def play_results(rng, folder, tally):
    """A file of results: it makes a report, which can be written."""
    path = folder / "results.json"
    base = samples()[rng.integers(len(samples()))]
    text = mutated(rng, base)
    path.write_bytes(text)

    def attempt():
        results = read_results(path)
        assert read_again(path.with_name("again.json"), results) == results
        results.to_csv()
        report = build_report(results)
        render_markdown(report, "figures")
        if rng.random() > DRAWN:
            return "results reported"
        write_report(report, folder / "out")
        for figure in report.figures():
            parse_json(plotly_json(figure))
        return "results drawn"

    judge(tally, "results", text, attempt)


def read_again(path, results):
    """The results as they come back from a file."""
    path.write_text(results.to_json())
    return read_results(path)


def play_record(rng, folder, tally):
    """The file of a finished cell."""
    source = sorted((FIXTURE / "cells").iterdir())[rng.integers(6)]
    path = folder / "cell.json"
    text = mutated(rng, json.loads(source.read_text()))
    path.write_bytes(text)

    def attempt():
        record = read_record(path, source.stem)
        parse_json(record.model_dump_json())
        return "cells accepted"

    judge(tally, "cell", text, attempt)


def play_marker(rng, folder, tally):
    """The file that marks the folder of a study."""
    study = folder / "study"
    study.mkdir(exist_ok=True)
    text = mutated(rng, json.loads((FIXTURE / "study.json").read_text()))
    (study / "study.json").write_bytes(text)

    def attempt():
        with StudyFolder(study).open(IDENTITY):
            return "markers accepted"

    judge(tally, "marker", text, attempt)


@cache
def samples():
    """Small results of each kind: of a plain report, of the paper's, with bounds, with a front."""
    found = [json.loads((FIXTURE / "results.json").read_text())]
    for name, places in (("results", (3, 10)), ("gap", (3,)), ("fairness", (3,))):
        data = json.loads((DOCS / name / "results.json").read_text())
        data["cells"] = [c for c in data["cells"] if c["axis"] in places][:40]
        for cell in data["cells"]:
            shorten(cell["record"])
        found.append(data)
    return found


def shorten(record):
    """A record of three episodes at most, and a training of a few points."""
    record["episodes"] = min(record["episodes"], 3)
    record["samples"] = {name: values[:3] for name, values in record["samples"].items()}
    if record["training"]:
        curve = record["training"]["curve"]
        record["training"]["curve"] = {name: values[-4:] for name, values in curve.items()}


def mutated(rng, data):
    """A file that says `data`, but for a few changes of what it says, or of its bytes."""
    if rng.random() < 0.8:
        data = copy.deepcopy(data)
        for _ in range(rng.choice((1, 2, 3), p=(0.7, 0.2, 0.1))):
            change(rng, data)
        return json.dumps(data).encode()
    text = bytearray(json.dumps(data).encode())
    for _ in range(rng.integers(1, 4)):
        text = bytearray(damaged(rng, bytes(text)))
    return bytes(text)


def change(rng, data):
    """Change one value, key or item somewhere in `data`."""
    place = data
    while True:
        keys = list(place) if isinstance(place, dict) else list(range(len(place)))
        if not keys:
            return
        key = keys[rng.integers(len(keys))]
        deeper = isinstance(place[key], dict | list) and place[key]
        if not deeper or rng.random() < 0.15:
            break
        place = place[key]
    kind = rng.integers(6)
    if kind == 0:
        del place[key]
    elif kind == 1 and isinstance(place, dict):
        place[str(STRANGE[rng.integers(len(STRANGE))])] = place.pop(key)
    elif kind == 1:
        place.append(copy.deepcopy(place[key]))
    elif kind == 2 and isinstance(place[key], int | float):
        place[key] *= (-1, 0, 2, 0.5, 1e6, 1e30)[rng.integers(6)]
    elif kind == 3 and isinstance(place, dict):
        other = keys[rng.integers(len(keys))]
        place[key], place[other] = place[other], place[key]
    else:
        alike = [value for value in STRANGE if type(value) is type(place[key])]
        values = alike if alike and rng.random() < 0.8 else STRANGE
        place[key] = copy.deepcopy(values[rng.integers(len(values))])


def damaged(rng, text):
    """The same bytes but for a few."""
    at, end = sorted(rng.integers(len(text) + 1, size=2))
    kind = rng.integers(7)
    if kind == 0:
        return text[:at]
    if kind == 1:
        return text[:at] + text[end:]
    if kind == 2:
        return text[:at] + bytes(rng.integers(256, size=8, dtype="uint8")) + text[at:]
    if kind == 3:
        return text[:at] + text[at:end][:2_000] + text[at:]
    if kind == 4:
        mark = (b"[", b'{"a":', b"- ", b"&a [*a,", b"!!set {", b"? ")[rng.integers(6)]
        return text[:at] + mark * (10, 1_000, 100_000 // len(mark))[rng.integers(3)] + text[at:]
    if kind == 5:
        return text[:at] + (b"1e999", b"NaN", b"9" * 5_000, b"\xff", b"")[rng.integers(5)]
    flipped = bytearray(text)
    if flipped:
        flipped[min(at, len(text) - 1)] ^= 1 << rng.integers(8)
    return bytes(flipped)


CAMPAIGN = Campaign("mutated studies and results", cases=2_000, short=60, run=run)
