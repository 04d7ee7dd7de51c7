"""How long it takes to show an episode: a picture, a frame of a film, a page that plays.

python benchmarks/showing.py [--repeats 5]
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import statistics
import time
from collections.abc import Callable

import machine

from iout_marl import Recording, record_policy
from iout_marl.render import as_picture
from iout_marl.replay.film import frames
from iout_marl.replay.page import render_page

SCENARIOS = ("paper/k10-fdd", "multi/m4-k50-fdd")


def frame_ms(recording: Recording) -> float:
    """ms of one frame of a film of the whole episode."""
    started = time.perf_counter()
    count = sum(1 for _ in frames([recording]))
    return 1e3 * (time.perf_counter() - started) / count


def picture_ms(recording: Recording) -> float:
    """ms of one slot's picture by itself."""
    started = time.perf_counter()
    as_picture(recording.snapshot(recording.slots // 2))
    return 1e3 * (time.perf_counter() - started)


def page_ms(recording: Recording) -> float:
    """ms of a page with the episode twice, side by side."""
    started = time.perf_counter()
    render_page([recording, recording])
    return 1e3 * (time.perf_counter() - started)


SUBJECTS: dict[str, Callable[[Recording], float]] = {
    "picture": picture_ms,
    "frame of a film": frame_ms,
    "page, two episodes": page_ms,
}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    repeats = parser.parse_args().repeats
    print(machine.describe())
    for scenario in SCENARIOS:
        recording = record_policy(scenario, "greedy")
        print(f"\nms, {scenario}, an episode of greedy, {repeats} rounds")
        print(f"{'':24}{'median':>10}{'min':>10}{'max':>10}")
        rounds = [[subject(recording) for subject in SUBJECTS.values()] for _ in range(repeats + 1)]
        # The first round makes fonts and figures ready.
        for name, *found in zip(SUBJECTS, *rounds[1:], strict=True):
            median = statistics.median(found)
            print(f"{name:24}{median:10.1f}{min(found):10.1f}{max(found):10.1f}")


if __name__ == "__main__":
    main()
