"""What no policy can beat: lower bounds on the mean AoI of a scenario.

The derivations stand in `docs/bounds.md`.
"""

from iout_marl.bounds.bound import (
    USUAL_SECONDS,
    Bound,
    bound,
    gap_percent,
    percent_text,
    rounded_down,
)
from iout_marl.bounds.certificate import Certificate, verified_age_sum
from iout_marl.bounds.scheduling import delivery_bound, least_age_sum

__all__ = [
    "USUAL_SECONDS",
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
