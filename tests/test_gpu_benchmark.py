"""The benchmark of a GPU: whatever one of its cases does, the others run and all is written."""

import importlib
import json
import os
import subprocess
import sys
from pathlib import Path

import forked
import pytest
import torch

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"

#: Each case of these steps but the last does something else that must not matter to it.
SCRIPT = f"""
import os, sys, time
sys.path.insert(0, {str(BENCHMARKS)!r})
import cases

def about(given):
    yield {{"name": "none"}}

def raises(given):
    yield {{"size": 1, "rate": float("nan")}}
    raise ValueError("on purpose\\nand more")

def crashes(given):
    yield {{"size": 2, "rate": 1.5}}
    os.abort()

def hangs(given):
    time.sleep(600)

def cannot(given):
    raise cases.LeftOut("there is no such thing")
    yield

def works(given):
    yield {{"size": 3, "device": given.device, "quick": given.quick}}

first = dict(raises=raises, crashes=crashes, cannot=cannot)
steps = {{
    "first": cases.Step("what goes wrong?", 60.0, first),
    "second": cases.Step("what hangs?", 3.0, {{"hangs": hangs}}),
    "third": cases.Step("what works?", 60.0, {{"works": works}}),
}}
cases.main("Nothing.", steps, about)
"""


@pytest.fixture
def gpu(monkeypatch):
    """The script as a module."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module("gpu")


def run(script, *arguments):
    """Run a script, where it can be in a process that has torch already; what it has printed."""
    if os.name == "nt":
        command = [sys.executable, str(script), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout
    begun = f"""
import runpy, sys
script = {str(script)!r}
sys.argv[0] = script
sys.path.insert(0, {str(BENCHMARKS)!r})
runpy.run_path(script, run_name="__main__")
sys.exit()
"""
    done = forked.run(*arguments, before=begun)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
@pytest.mark.posix
def test_no_case_takes_another_along(tmp_path):
    script, out = tmp_path / "script.py", tmp_path / "found.json"
    script.write_text(SCRIPT, encoding="utf-8")
    printed = run(script, "--device", "cpu", "--quick", "--out", str(out))
    steps = json.loads(out.read_text("utf-8"))["steps"]
    assert list(steps) == ["first", "second", "third"]
    first = steps["first"]["cases"]
    assert first["raises"]["state"] == "failed"
    assert first["raises"]["reason"] == "ValueError: on purpose"
    assert first["raises"]["rows"] == [{"size": 1, "rate": None}]
    assert "in raises" in first["raises"]["printed"]
    assert first["crashes"]["state"] == "failed"
    assert first["crashes"]["reason"].startswith("SIGABRT, File ")
    assert first["crashes"]["rows"] == [{"size": 2, "rate": 1.5}]
    assert (first["cannot"]["state"], first["cannot"]["reason"]) == (
        "left out",
        "there is no such thing",
    )
    hung = steps["second"]["cases"]["hangs"]
    assert hung["state"] == "stopped"
    assert hung["reason"].startswith("not done after 3 s")
    works = steps["third"]["cases"]["works"]
    assert works["state"] == "done"
    assert works["rows"] == [{"size": 3, "device": "cpu", "quick": True}]
    assert "raises" in printed
    assert "failed: ValueError: on purpose" in printed


@pytest.mark.slow
@pytest.mark.posix
def test_what_there_is_no_time_for_is_named(tmp_path):
    script, out = tmp_path / "script.py", tmp_path / "found.json"
    script.write_text(SCRIPT, encoding="utf-8")
    run(script, "--device", "cpu", "--steps", "third", "--minutes", "0", "--out", str(out))
    works = json.loads(out.read_text("utf-8"))["steps"]["third"]["cases"]["works"]
    assert works == {"state": "left out", "reason": "no time left", "rows": []}


@pytest.mark.slow
@pytest.mark.posix
def test_without_a_device_every_step_says_so(tmp_path, monkeypatch, gpu):
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "")
    out = tmp_path / "found.json"
    printed = run(BENCHMARKS / "gpu.py", "--out", str(out))
    found = json.loads(out.read_text("utf-8"))
    assert found["steps"] == {step: {"state": "no CUDA device"} for step in gpu.STEPS}
    for step in gpu.STEPS:
        assert f"{step}: no CUDA device\n" in printed


@pytest.mark.slow
@pytest.mark.parametrize(
    ("step", "case", "key", "right"),
    [
        ("equal", "4 policies", "equal", "yes"),
        ("nccl", "eager", "found", ("right", "equal")),
    ],
)
def test_cases_run_on_a_cpu(tmp_path, step, case, key, right):
    rows = tmp_path / "rows"
    told = ("--device", "cpu", "--quick", "--case", step, case, str(rows), "250")
    run(BENCHMARKS / "gpu.py", *told)
    found = [json.loads(line)["row"] for line in rows.read_text("utf-8").splitlines()]
    assert len(found) > 1
    for row in found:
        assert row[key].startswith(right)


def test_where_a_case_hangs_is_told(monkeypatch, gpu):
    cases = importlib.import_module("cases")
    printed = (
        "begun\nTimeout (0:00:03)!\n"
        'Thread 0x01 (most recent call first):\n  File "pool.py", line 1 in wait\n\n'
        'Thread 0x02 (most recent call first):\n  File "gpu.py", line 7 in measure\n'
        '  File "gpu.py", line 9 in main\n'
    )
    expected = ("stopped", 'not done after 3 s, File "gpu.py", line 7 in measure')
    assert cases.why(1, printed, 3.0) == expected
    assert cases.why(None, "", 3.0) == ("stopped", "not done after 3 s")
    assert cases.why(1, "Traceback\nKeyError: 'x'\n", 3.0) == ("failed", "KeyError: 'x'")


@pytest.mark.usefixtures("gpu")
def test_tensors_that_differ():
    equality = importlib.import_module("on_gpu.equality")
    one = torch.tensor([1.0, float("nan"), -4.0])
    assert equality.difference(one, one.clone()) is None
    other = torch.tensor([1.5, float("nan"), -4.0])
    assert equality.difference(one[::2], other[::2]) == "1 of 2 numbers, by 0.5 at most, of 4"
    assert equality.difference(one, other).startswith("1 of 3 numbers")
    assert equality.difference(one, torch.zeros(3)).startswith("3 of 3 numbers")
    flags = torch.tensor([True, False])
    assert equality.difference(flags, ~flags) == "2 of 2 numbers, by 1 at most, of 1"


@pytest.mark.usefixtures("gpu")
def test_figures_of_a_trace():
    profiling = importlib.import_module("on_gpu.profiling")

    def event(cat, name, ts, dur):
        return {"ph": "X", "cat": cat, "name": name, "ts": ts, "dur": dur}

    events = [
        {"ph": "M", "name": "process_name"},
        event("cpu_op", "aten::add", 0, 500),
        event("cuda_runtime", "cudaLaunchKernel", 1, 2),
        event("cuda_runtime", "cudaLaunchKernelExC", 5, 2),
        event("cuda_runtime", "cudaGraphLaunch", 9, 2),
        event("cuda_runtime", "cudaStreamSynchronize", 20, 300),
        event("kernel", "add", 160, 30),  # after a gap, and over the next one's begin
        event("kernel", "mul", 100, 20),
        event("kernel", "add", 185, 15),
        event("gpu_memcpy", "Memcpy DtoH (Device -> Pinned)", 205, 5),
        event("gpu_memset", "Memset (Device)", 120, 10),
    ]
    rows = list(profiling.figures_of(events, most=2))
    figures = {row["figure"]: row["value"] for row in rows if "figure" in row}
    assert figures == {
        "kernels, copies and fills": 5,
        "time of all of them, ms": pytest.approx(0.080),
        "from the first to the end of the last, ms": pytest.approx(0.110),
        "gaps in between, ms": pytest.approx(0.035),
        "gaps of more than 10 µs": 1,
        "longest gap, µs": 30,
        "launches of kernels": 2,
        "launches of graphs": 1,
        "waits of the host (one is the profile's)": 1,
        "waits of the host, ms": pytest.approx(0.3),
        "copies to the host": 1,
        "copies to the device": 0,
    }
    assert [(row["kernel"], row["calls"], row["ms"]) for row in rows if "kernel" in row] == [
        ("add", 2, pytest.approx(0.045)),
        ("mul", 1, pytest.approx(0.020)),
    ]
