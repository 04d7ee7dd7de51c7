"""How long it takes to begin: commands, the package, a training up to its first update.

Each is a process of its own; subjects take turns within a round. Of a training, what is beyond the
import of torch alone, in a process of the same round, is the software's own.

    python benchmarks/start.py [--repeats 9]
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import machine

IOUT = (sys.executable, "-m", "iout_marl")
TORCH = "python -c 'import torch'"
TRAINING = "iout train, to its first update"


def finished(*command: str) -> Callable[[], float]:
    """Measures the seconds of a whole process."""

    def measure() -> float:
        started = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True, env=_one_thread())
        return time.perf_counter() - started

    return measure


def first_update() -> float:
    """Seconds from the start of a process until a training has logged its first update."""
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        command: Sequence[str] = (*IOUT, "train", "paper/k10-fdd", "--out", f"{folder}/run")
        with subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=_one_thread()
        ) as process:
            metrics = Path(folder) / "run" / "metrics.jsonl"
            while not (metrics.is_file() and metrics.stat().st_size):
                if process.poll() is not None:
                    raise RuntimeError(f"the training ended with status {process.returncode}")
                time.sleep(0.002)
            seconds = time.perf_counter() - started
            process.terminate()
    return seconds


def _one_thread() -> dict[str, str]:
    return {**os.environ, "OMP_NUM_THREADS": "1"}


SUBJECTS: dict[str, Callable[[], float]] = {
    "python -c pass": finished(sys.executable, "-c", "pass"),
    "python -c 'import numpy'": finished(sys.executable, "-c", "import numpy"),
    "python -c 'import iout_marl'": finished(sys.executable, "-c", "import iout_marl"),
    "iout --help": finished(*IOUT, "--help"),
    "iout show paper/k10-fdd": finished(*IOUT, "show", "paper/k10-fdd"),
    "iout evaluate, greedy, 1 episode": finished(
        *(*IOUT, "evaluate", "paper/k10-fdd", "--policy", "greedy", "--episodes", "1")
    ),
    TORCH: finished(sys.executable, "-c", "import torch"),
    TRAINING: first_update,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=9)
    options = parser.parse_args()
    seconds: dict[str, list[float]] = {name: [] for name in SUBJECTS}
    for number in range(options.repeats + 1):
        for name, measure in SUBJECTS.items():
            found = measure()
            if number:  # the first one brings files into memory
                seconds[name].append(found)
    print(machine.describe())
    print(f"\nseconds, {options.repeats} rounds{'median':>18s}{'min':>8s}{'max':>8s}")
    beyond = [t - o for t, o in zip(seconds[TRAINING], seconds[TORCH], strict=True)]
    for name, values in {**seconds, "the training beyond torch": beyond}.items():
        row = (statistics.median(values), min(values), max(values))
        print(f"{name:34s}" + "".join(f"{v:8.2f}" for v in row))


if __name__ == "__main__":
    main()
