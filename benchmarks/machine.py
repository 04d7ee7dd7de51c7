"""What a figure was measured on and with."""

from __future__ import annotations

import os
import platform
from importlib.metadata import version
from pathlib import Path

PACKAGES = (
    "iout-marl",
    "numpy",
    "torch",
    "gymnasium",
    "pettingzoo",
    "supersuit",
    "stable-baselines3",
)


def describe() -> str:
    """Processor, cores, Python and package versions, in two lines."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    versions = ", ".join(f"{name} {version(name)}" for name in PACKAGES)
    return f"{_processor()}, {cores} cores, Python {platform.python_version()}\n{versions}"


def _processor() -> str:
    try:
        with Path("/proc/cpuinfo").open(encoding="ascii") as file:
            for line in file:
                if line.startswith("model name"):
                    return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
