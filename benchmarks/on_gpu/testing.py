"""The tests that need a CUDA device."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator

from cases import ROOT, Case, Given, Row


def run_tests(*arguments: str) -> Case:
    """Tests, each failure with its reason."""

    def measure(_: Given) -> Iterator[Row]:
        options = ["-vv", "-rfE", "--tb=short", "-p", "no:cacheprovider"]
        command = [sys.executable, "-m", "pytest", *options, "-o", "faulthandler_timeout=60"]
        counts = dict.fromkeys(("PASSED", "FAILED", "ERROR", "SKIPPED"), 0)
        reasons: dict[str, str] = {}
        with subprocess.Popen(
            [*command, *arguments], cwd=ROOT, stdout=subprocess.PIPE, text=True
        ) as process:
            assert process.stdout is not None
            for line in process.stdout:
                print(line, end="")
                if found := re.match(r"(tests/\S*::.*?) (PASSED|FAILED|ERROR|SKIPPED)\b", line):
                    counts[found[2]] += 1
                elif found := re.match(r"(?:FAILED|ERROR) (tests/\S*::.*?) - (.*)", line):
                    reasons[found[1]] = found[2]
        yield {name.lower(): count for name, count in counts.items()}
        for test, why in reasons.items():
            yield {"test": test, "why": why}
        if process.returncode not in (0, 1, 5):  # passed, failed, none collected
            raise RuntimeError(f"pytest has ended with exit status {process.returncode}")

    return measure


def tests_of_gpus() -> list[str]:
    """Files with tests that are marked so."""
    found = [
        path.relative_to(ROOT).as_posix()
        for path in sorted((ROOT / "tests").rglob("test_*.py"))
        if re.search(r"needs_cuda|mark\.gpu", path.read_text(encoding="utf-8"))
    ]
    assert found
    return found


OF_GRAPHS = ["tests/trainers/test_graphs.py", "tests/trainers/test_accelerator.py"]
