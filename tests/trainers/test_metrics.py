"""The log of a run: damaged lines are skipped, and said to be."""

import io
import json

import pytest
from rich.console import Console

from iout_marl import InputError
from iout_marl.study.worker import CURVES, _curve
from trainers import train
from trainers.runs.metrics import read_rows, row

GOOD = [{"env_steps": 80, "aoi/mean": 3.5}, {"env_steps": 160, "aoi/mean": None}]
DAMAGED = {
    "cut short": b'{"env_steps": 80, "aoi',
    "nested": b"[" * 100_000,
    "nested objects": b'{"a":' * 100_000,
    "no object": b"[1, 2]",
    "null": b"null",
    "without steps": b'{"aoi/mean": 3}',
    "steps that are no number": b'{"env_steps": "80"}',
    "steps that are no whole number": b'{"env_steps": 80.5}',
    "steps that are true": b'{"env_steps": true}',
    "fewer than no steps": b'{"env_steps": -80}',
    "too many steps": b'{"env_steps": 1' + b"0" * 300 + b"}",
    "too many digits": b'{"env_steps": 1' + b"0" * 5000 + b"}",
    "not a number": b'{"env_steps": 80, "aoi/mean": NaN}',
    "infinite": b'{"env_steps": 80, "aoi/mean": 1e400}',
    "text": b'{"env_steps": 80, "aoi/mean": "x"}',
    "list": b'{"env_steps": 80, "aoi/mean": [1]}',
    "no text": b"\xff\xfe\x00",
}


@pytest.mark.parametrize("line", DAMAGED.values(), ids=list(DAMAGED))
def test_damaged_line_is_skipped_and_those_after_it_are_not(tmp_path, line):
    path = tmp_path / "metrics.jsonl"
    first, second = (json.dumps(each).encode() for each in GOOD)
    path.write_bytes(b"\n".join([first, line, b"", second, line]) + b"\n")
    assert read_rows(path) == (GOOD, 2)


def test_no_log(tmp_path):
    assert read_rows(tmp_path / "none") == ([], 0)
    with pytest.raises(InputError, match="no regular file"):
        read_rows(tmp_path)


def test_figures_that_are_not_finite_are_null():
    assert json.loads(row(80, {"a": float("nan"), "b": float("inf"), "c": 1.5})) == {
        "env_steps": 80, "a": None, "b": None, "c": 1.5
    }  # fmt: skip


def test_resumed_run_says_how_many_were_skipped(tiny, tmp_path):
    run, said = tmp_path / "run", io.StringIO()
    quiet = {"console": Console(file=said, width=500), "evaluation_episodes": 1}
    train(tiny({"training.steps": 240}), run, **quiet)
    path = run / "metrics.jsonl"
    first, *others = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(first + b"{\n" + b"".join(others) + b'{"env_st')
    train(tiny(), run, resume=True, **quiet)
    assert f"{path}: 2 damaged lines were skipped" in said.getvalue()
    rows, skipped = read_rows(path)
    assert [each["env_steps"] for each in rows] == list(range(80, 561, 80))
    assert skipped == 0


def test_curve_of_a_study_takes_the_rows_that_are_whole(tmp_path):
    path = tmp_path / "metrics.jsonl"
    whole = [{"env_steps": 80 * i, **dict.fromkeys(CURVES, float(i))} for i in (1, 2)]
    lines = [json.dumps(each) for each in (whole[0], {"aoi/mean": 3}, {"env_steps": 3}, whole[1])]
    path.write_text("\n".join([*lines, "[" * 100_000, json.dumps({**whole[0], CURVES[0]: None})]))
    assert _curve(path) == {
        "env_steps": [80, 160], **{name: [1.0, 2.0] for name in CURVES}
    }  # fmt: skip
