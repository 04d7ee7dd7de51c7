"""Differences and ratios of what was measured, with intervals; numbers as text."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from iout_marl.bounds import rounded_down
from iout_marl.evaluation import Estimate
from iout_marl.metrics import described
from iout_marl.report.markup import as_data
from iout_marl.study.results import Measured, Record

#: From here on numbers are written with a power of ten.
MOST_DIGITS = 1e12
#: Holds a number and its unit together.
NO_BREAK = "\N{NO-BREAK SPACE}"


@dataclass(frozen=True)
class _Moments:
    mean: np.float64  # NumPy's numbers: a division by 0 gives no error, but NaN or an infinity
    squared_error: np.float64  # of the mean; NaN for a single sample
    freedom: int

    @classmethod
    def from_measured(cls, measured: Measured) -> _Moments:
        values = np.asarray(measured.samples, dtype=np.float64)
        count = len(values)
        error = values.var(ddof=1) / count if count > 1 else math.nan
        return cls(np.float64(values.mean()), np.float64(error), count - 1)


@np.errstate(all="ignore")
def difference(first: Measured, second: Measured) -> Estimate:
    """first − second, with Welch's 95 % interval (NaN where either is a single value)."""
    a, b = _Moments.from_measured(first), _Moments.from_measured(second)
    return _welch(a.mean - b.mean, a.squared_error, b.squared_error, (a.freedom, b.freedom))


@np.errstate(all="ignore")
def reduction(first: Measured, second: Measured) -> Estimate:
    """1 − first/second: by how much of itself the second is reduced.

    The 95 % interval is that of the ratio by the delta method, with Welch's degrees of
    freedom; NaN where either is a single value. Of 0 there is no reduction: NaN throughout.
    """
    a, b = _Moments.from_measured(first), _Moments.from_measured(second)
    if b.mean == 0:
        return Estimate(math.nan, math.nan, math.nan)
    # Relative errors of first/second, times the ratio, without a division by first.
    return _welch(
        1 - a.mean / b.mean,
        a.squared_error / b.mean**2,
        b.squared_error * a.mean**2 / b.mean**4,
        (a.freedom, b.freedom),
    )


def _welch(
    value: np.float64, first: np.float64, second: np.float64, freedom: tuple[int, int]
) -> Estimate:
    error = first + second
    if not math.isfinite(error):
        return Estimate(float(value), math.nan, math.nan)
    if error == 0:
        return Estimate(float(value), float(value), float(value))
    # Shares of the whole, whose squares are neither too small nor too large for a number.
    degrees = 1 / ((first / error) ** 2 / freedom[0] + (second / error) ** 2 / freedom[1])
    margin = float(stdtrit(degrees, 0.975) * np.sqrt(error))
    return Estimate(float(value), float(value) - margin, float(value) + margin)


def ratio(value: float, of: float) -> float:
    """value/of; NaN where that is no number."""
    try:
        found = value / of
    except (ZeroDivisionError, OverflowError):
        return math.nan
    return found if math.isfinite(found) else math.nan


def samples(records: Iterable[Record], metric: str) -> list[float]:
    """A metric in every episode of the records that have it."""
    return [value for record in records for value in record.samples.get(metric, ())]


def fixed(value: float, digits: int) -> str:
    """A number with so many digits behind the point; what is rounded to 0 has no sign."""
    if not math.isfinite(value):
        return "–"
    text = f"{value:.{digits}f}" if abs(value) < MOST_DIGITS else f"{value:.3e}"
    return text.removeprefix("-") if float(text) == 0 else text


def bound_text(value: float, digits: int) -> str:
    """A certified bound, which is never more than it is."""
    return rounded_down(value, digits) if abs(value) < MOST_DIGITS else fixed(value, digits)


def has_interval(estimate: Estimate) -> bool:
    """Whether there is an interval to tell of: not of one value, nor of values all alike."""
    return math.isfinite(estimate.high - estimate.low) and estimate.low < estimate.high


def number(estimate: Estimate, digits: int, unit: str = "") -> str:
    """`3.54 (3.42 to 3.66)`: a mean and its interval, where it has one."""
    unit = unit and f"{NO_BREAK}{unit}"
    mean = f"{fixed(estimate.mean, digits)}{unit}"
    if not has_interval(estimate):
        return mean
    return f"{mean} ({fixed(estimate.low, digits)} to {fixed(estimate.high, digits)})"


def percent(estimate: Estimate) -> str:
    """`35 % (31 to 39)` for 0.35: a share and its interval, where it has one."""
    hundred = Estimate(100 * estimate.mean, 100 * estimate.low, 100 * estimate.high)
    return number(hundred, 1 if abs(hundred.mean) < 10 else 0, "%")


def metric(measured: Measured | None, name: str) -> str:
    """A metric with its interval; a dash where it was not measured."""
    return "–" if measured is None else number(measured.estimate, described(name).digits)


def metric_mean(value: float, name: str) -> str:
    """A value of a metric, with its digits."""
    return fixed(value, described(name).digits)


def metric_heading(name: str) -> str:
    """What an axis or a column of a metric is called."""
    return as_data(described(name).axis_title)


def duration(seconds: float) -> str:
    """`8 h 11 min`, `2 min 5 s` or `24 s`."""
    if not 0 <= seconds < MOST_DIGITS:
        return "–"
    seconds = round(seconds)
    if seconds >= 3600:
        hours, minutes = divmod(round(seconds / 60), 60)
        return f"{hours} h {minutes} min"
    minutes, seconds = divmod(seconds, 60)
    parts = ([f"{minutes} min"] if minutes else []) + ([f"{seconds} s"] if seconds else [])
    return " ".join(parts) or "0 s"
