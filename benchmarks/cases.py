"""Runs the steps of a benchmark, each case of a step in a process of its own.

A case yields rows of figures. What it has yielded is kept when it raises, hangs, or takes its
process along, and the next case starts. A script gives its steps to `main`; the JSON is
written anew after every case.
"""

from __future__ import annotations

import argparse
import datetime as dt
import faulthandler
import json
import math
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import machine

from iout_marl.files import to_json, write_text
from iout_marl.machine import describe

#: When this process was, but for what Python itself takes.
STARTED = time.perf_counter()
ROOT = Path(__file__).parent.parent
#: What a case that hangs gets to say where, before it is stopped.
GRACE_S = 10.0
#: What a case needs to come to anything.
LEAST_S = 15.0
#: Characters of what a case that failed has printed that are kept.
KEPT = 8000
INTERRUPTED = "interrupted"

Row = dict[str, Any]


class LeftOut(Exception):  # noqa: N818 (it is no error)
    """A case cannot run here; the message says why."""


class Given(NamedTuple):
    """What a case is told."""

    device: str  # cpu or cuda
    quick: bool


Case = Callable[[Given], Iterator[Row]]


class Step(NamedTuple):
    """Cases that answer one question, the most worthwhile first."""

    question: str
    limit_s: float  # of each case
    cases: dict[str, Case]


if "--case" in sys.argv:
    # Before anything else is imported, which may hang, too.
    faulthandler.enable()
    faulthandler.dump_traceback_later(float(sys.argv[-1]), exit=True)


def play(case: Case, given: Given, path: Path) -> None:
    """In a process of its own: run a case, and write a line for every row."""
    with path.open("a", encoding="utf-8") as file:

        def write(line: Row) -> None:
            print(to_json(line), file=file, flush=True)

        try:
            for row in case(given):
                write({"row": {key: _finite(value) for key, value in row.items()}})
        except LeftOut as reason:
            write({"left out": str(reason)})
        except Exception as error:
            first = str(error).strip().partition("\n")[0]
            write({"error": f"{type(error).__name__}: {first}"})
            raise
    faulthandler.cancel_dump_traceback_later()


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def run(step: str, case: str, given: Given, limit_s: float) -> dict[str, Any]:
    """Have a case run, and wait for it at most so long."""
    started = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        rows, log = Path(folder) / "rows", Path(folder) / "log"
        rows.touch()
        command = [sys.executable, "-u", sys.argv[0], "--device", given.device]
        command += ["--quick"] if given.quick else []
        command += ["--case", step, case, str(rows), str(limit_s)]
        with (
            log.open("wb") as output,
            subprocess.Popen(
                command, stdout=output, stderr=subprocess.STDOUT, start_new_session=True
            ) as process,
        ):
            code, is_interrupted = None, False
            try:
                code = process.wait(limit_s + GRACE_S)
            except subprocess.TimeoutExpired:
                pass
            except KeyboardInterrupt:
                is_interrupted = True
            finally:
                _end(process)
        # A line is whole once it has its end.
        text = rows.read_text("utf-8")
        lines = [json.loads(line) for line in text[: text.rfind("\n") + 1].splitlines()]
        printed = log.read_text("utf-8", errors="replace").strip()
    found = {
        "state": "done",
        "seconds": round(time.monotonic() - started, 1),
        "rows": [line["row"] for line in lines if "row" in line],
    }
    if is_interrupted:
        return {**found, "state": INTERRUPTED, "reason": "by the user"}
    last = lines[-1] if lines else {}
    if code == 0 and "left out" in last:
        return {**found, "state": "left out", "reason": last["left out"]}
    if code == 0:
        return found
    state, reason = why(code, printed, limit_s)
    return {
        **found,
        "state": state,
        "reason": last.get("error", reason),
        "printed": printed[-KEPT:],
    }


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a case with all that it has started."""
    if os.name == "posix":
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()


def why(code: int | None, printed: str, limit_s: float) -> tuple[str, str]:
    """State and reason of a case that has not come to its end.

    Args:
        code: its exit status; None where it had to be killed.
        printed: what it has printed.
        limit_s: how long it was given.
    """
    place = re.findall(r"\(most recent call first\):\n +(File .*)", printed)
    # The main thread comes last.
    at = f", {place[-1]}" if place else ""
    if code is None or re.search(r"^Timeout \(\d", printed, re.MULTILINE):
        return "stopped", f"not done after {limit_s:.0f} s{at}"
    if code < 0:
        return "failed", f"{signal.Signals(-code).name}{at}"
    return "failed", (printed.splitlines() or [f"exit status {code}"])[-1].strip()


class Table:
    """Prints rows, with headings where these change."""

    def __init__(self) -> None:
        self._headings: list[str] = []

    def show(self, case: str, outcome: dict[str, Any]) -> None:
        """Print what has come of a case."""
        for row in outcome["rows"]:
            if list(row) != self._headings:
                self._headings = list(row)
                print(f"  {'':32s}" + "".join(f"{key:>{_width(key)}s}" for key in row))
            print(f"  {case:32s}" + "".join(_cell(key, value) for key, value in row.items()))
        if outcome["state"] != "done":
            print(f"  {case:32s}  {outcome['state']}: {outcome['reason']}")
        sys.stdout.flush()


def _width(key: str) -> int:
    return max(14, len(key) + 2)


def _cell(key: str, value: Any) -> str:
    if isinstance(value, str):
        return f"  {value:<{_width(key) - 2}s}"
    if value is None:
        text = "-"
    elif isinstance(value, int) or abs(value) >= 100:
        text = f"{value:,.0f}"
    else:
        text = f"{value:.3g}"
    return f"{text:>{_width(key)}s}"


def commit() -> str | None:
    """Which commit this is, and whether files differ from it."""
    try:
        found = subprocess.run(
            ["git", "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return found.stdout.strip()


def main(description: str, steps: dict[str, Step], about: Case) -> None:
    """Run what was asked for, print it, and write it.

    Args:
        description: of the script.
        steps: by name, the most worthwhile first.
        about: tells the device in one row, which is empty where there is none.
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--steps", nargs="+", choices=list(steps), default=list(steps))
    parser.add_argument("--minutes", type=float, default=30.0, help="for all steps together")
    parser.add_argument("--quick", action="store_true", help="small sizes")
    parser.add_argument("--device", choices=["cpu", "cuda"], default="cuda")
    parser.add_argument("--out", type=Path, default=Path("gpu.json"))
    parser.add_argument("--case", nargs=4, help=argparse.SUPPRESS)
    options = parser.parse_args()
    given = Given(options.device, options.quick)
    known = {**steps, "about": Step("", 60.0, {"device": about})}
    if options.case:
        step, case, path, _limit_s = options.case
        play(known[step].cases[case], given, Path(path))
        return
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    deadline = time.monotonic() + 60 * options.minutes
    found: dict[str, Any] = {
        "date": dt.datetime.now(dt.UTC).isoformat(timespec="seconds"),
        "commit": commit(),
        "command": sys.argv,
        "machine": describe(),
        "steps": {},
    }
    device = run("about", "device", given, 60.0)
    found["device"] = device["rows"][0] if device["rows"] else device
    print(machine.describe())
    has_none = device["state"] == "done" and not device["rows"][0]
    told = ", ".join(f"{key} {value}" for key, value in found["device"].items() if key != "rows")
    print(f"device: {'none here' if has_none else told}", flush=True)
    for name in options.steps:
        step = steps[name]
        if has_none:
            found["steps"][name] = {"state": "no CUDA device"}
            print(f"{name}: no CUDA device", flush=True)
            write_text(options.out, to_json(found, indent=1))
            continue
        print(f"\n{name}: {step.question}", flush=True)
        outcomes = found["steps"][name] = {"state": "done", "cases": {}}
        table = Table()
        for case in step.cases:
            left_s = deadline - time.monotonic()
            if left_s < LEAST_S:
                outcome = {"state": "left out", "reason": "no time left", "rows": []}
            else:
                outcome = run(name, case, given, min(step.limit_s, left_s))
            outcomes["cases"][case] = outcome
            table.show(case, outcome)
            write_text(options.out, to_json(found, indent=1))
            if outcome["state"] == INTERRUPTED:
                sys.exit(130)
