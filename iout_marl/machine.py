"""What a figure was measured on and with."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

#: Packages whose versions can change a result.
PACKAGES = ("iout-marl", "numpy", "torch")


def num_cores() -> int:
    """Processor cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def processor() -> str:
    """Name of the processor."""
    return _said_by_linux("model name") or platform.processor() or platform.machine()


def is_by_intel() -> bool:
    """Whether the processor is one of Intel's."""
    return "Intel" in (_said_by_linux("vendor_id") or platform.processor())


def _said_by_linux(key: str) -> str:
    """What Linux says of the processor; "" where it says nothing."""
    try:
        with Path("/proc/cpuinfo").open(encoding="ascii", errors="replace") as file:
            for line in file:
                if line.startswith(key):
                    return line.partition(":")[2].strip()
    except OSError:
        pass
    return ""


def versions(packages: Iterable[str] = PACKAGES) -> dict[str, str]:
    """Versions of Python and of those of the packages that are installed."""
    found = {"Python": platform.python_version()}
    for name in packages:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def describe() -> dict[str, str]:
    """Processor, cores, system and versions."""
    return {
        "processor": processor(),
        "cores": str(num_cores()),
        "system": platform.system(),
        **versions(),
    }
