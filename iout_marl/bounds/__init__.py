"""What no policy can beat: lower bounds on the mean AoI of a scenario.

The derivations stand in `docs/bounds.md`.
"""

from typing import Any

from iout_marl.bounds.bound import (
    DEFAULT_SECONDS,
    Bound,
    bound,
    gap_percent,
    percent_text,
    rounded_down,
)
from iout_marl.bounds.certificate import Certificate, verified_age_sum
from iout_marl.bounds.scheduling import delivery_bound, least_age_sum
from iout_marl.deprecated import warn_renamed

__all__ = [
    "DEFAULT_SECONDS",
    "Bound",
    "Certificate",
    "bound",
    "delivery_bound",
    "gap_percent",
    "least_age_sum",
    "percent_text",
    "rounded_down",
    "verified_age_sum",
]

#: What names of the version before are called now.
_RENAMED = {"USUAL_SECONDS": "DEFAULT_SECONDS"}


def __getattr__(name: str) -> Any:
    if name not in _RENAMED:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    warn_renamed(f"iout_marl.bounds.{name}", f"iout_marl.bounds.{_RENAMED[name]}")
    return globals()[_RENAMED[name]]
