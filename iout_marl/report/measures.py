"""Differences and ratios of what was measured, with intervals; numbers as text."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from iout_marl.evaluation import Estimate
from iout_marl.study.results import Measured

#: Digits behind the point, and the unit, of each metric in texts.
METRIC_DIGITS = {
    "mean_aoi": 2,
    "final_aoi": 2,
    "peak_aoi": 1,
    "jain": 3,
    "harvested_kj": 2,
    "spent_kj": 2,
    "uplink_success": 3,
    "reward": 1,
    "age_violations": 1,
    "jain_violation": 2,
}

#: Holds a number and its unit together.
NO_BREAK = "\N{NO-BREAK SPACE}"


@dataclass(frozen=True)
class _Moments:
    mean: float
    squared_error: float  # of the mean; NaN for a single sample
    freedom: int

    @classmethod
    def of(cls, measured: Measured) -> _Moments:
        values = np.asarray(measured.samples)
        count = len(values)
        error = float(values.var(ddof=1)) / count if count > 1 else math.nan
        return cls(float(values.mean()), error, count - 1)


def difference(first: Measured, second: Measured) -> Estimate:
    """first − second, with Welch's 95 % interval (NaN where either is a single value)."""
    a, b = _Moments.of(first), _Moments.of(second)
    return _welch(
        a.mean - b.mean, a.squared_error, b.squared_error, (a.freedom, b.freedom), scale=1.0
    )


def reduction(first: Measured, second: Measured) -> Estimate:
    """1 − first/second: by how much of itself the second is reduced.

    The 95 % interval is that of the ratio by the delta method, with Welch's degrees of
    freedom; NaN where either is a single value.
    """
    a, b = _Moments.of(first), _Moments.of(second)
    ratio = a.mean / b.mean
    return _welch(
        1 - ratio,
        a.squared_error / a.mean**2,
        b.squared_error / b.mean**2,
        (a.freedom, b.freedom),
        scale=abs(ratio),
    )


def _welch(
    value: float, first: float, second: float, freedom: tuple[int, int], *, scale: float
) -> Estimate:
    error = first + second
    if math.isnan(error):
        return Estimate(value, math.nan, math.nan)
    if error == 0:
        return Estimate(value, value, value)
    degrees = error**2 / (first**2 / freedom[0] + second**2 / freedom[1])
    margin = scale * float(stdtrit(degrees, 0.975)) * math.sqrt(error)
    return Estimate(value, value - margin, value + margin)


def number(estimate: Estimate, digits: int, unit: str = "") -> str:
    """`3.54 (3.42 to 3.66)`: a mean and its interval, where it has one."""
    unit = unit and f"{NO_BREAK}{unit}"
    if math.isnan(estimate.low):
        return f"{estimate.mean:.{digits}f}{unit}"
    mean, low, high = (f"{v:.{digits}f}" for v in (estimate.mean, estimate.low, estimate.high))
    return f"{mean}{unit} ({low} to {high})"


def percent(estimate: Estimate) -> str:
    """`35 % (31 to 39)` for 0.35: a share and its interval, where it has one."""
    hundred = Estimate(100 * estimate.mean, 100 * estimate.low, 100 * estimate.high)
    return number(hundred, 1 if abs(hundred.mean) < 10 else 0, "%")


def metric(measured: Measured | None, name: str) -> str:
    """A metric with its interval; a dash where it was not measured."""
    return "–" if measured is None else number(measured.estimate, METRIC_DIGITS[name])


def place_text(place: float) -> str:
    """A place on the axis: `3`, `0.5`, `2,304,000`."""
    return f"{place:,.12g}"


def duration(seconds: float) -> str:
    """`8 h 11 min`, `2 min 5 s` or `24 s`."""
    seconds = round(seconds)
    if seconds >= 3600:
        hours, minutes = divmod(round(seconds / 60), 60)
        return f"{hours} h {minutes} min"
    minutes, seconds = divmod(seconds, 60)
    parts = ([f"{minutes} min"] if minutes else []) + ([f"{seconds} s"] if seconds else [])
    return " ".join(parts) or "0 s"
