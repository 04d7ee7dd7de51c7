"""What a benchmark was measured on and with, in two lines."""

from __future__ import annotations

from iout_marl.machine import PACKAGES, num_cores, processor, versions

COMPARED_WITH = ("gymnasium", "pettingzoo", "supersuit", "stable-baselines3", "mpe2", "vmas")


def describe() -> str:
    """Processor, cores, Python and package versions."""
    found = versions((*PACKAGES, *COMPARED_WITH))
    python = found.pop("Python")
    packages = ", ".join(f"{name} {number}" for name, number in found.items())
    return f"{processor()}, {num_cores()} cores, Python {python}\n{packages}"
