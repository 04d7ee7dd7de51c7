"""Single statements, and whether what was measured agrees with them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from iout_marl.evaluation import Estimate
from iout_marl.report.document import Verdict
from iout_marl.report.measures import NO_BREAK, difference, number, percent, reduction
from iout_marl.report.study_figures import at_place
from iout_marl.study.results import Measured, Results

#: "About x" leaves room for this share of x.
ABOUT = 0.2


@dataclass(frozen=True)
class Check:
    """A statement about one figure.

    Attributes:
        text: the figure, with its interval and where it stands.
        holds: whether the statement is true of it.
        open: whether the interval leaves it open; then it does not hold.
        single: whether it rests on a single value, without an interval.
    """

    text: str
    holds: bool
    open: bool = False
    single: bool = False

    def __str__(self) -> str:
        return f"{self.text} {'✓' if self.holds else '?' if self.open else '✗'}"

    @classmethod
    def positive(cls, text: str, estimate: Estimate) -> Check:
        """That a difference is above 0 with its whole interval, or by itself without one."""
        if math.isnan(estimate.low):
            return cls(text, estimate.mean > 0, single=True)
        return cls(text, estimate.low > 0, open=estimate.low <= 0 < estimate.high)


@dataclass(frozen=True)
class Finding:
    """A group of like statements: `what` they say, and each of them."""

    what: str
    checks: tuple[Check, ...]

    def __str__(self) -> str:
        return f"{self.what}: {'; '.join(map(str, self.checks)) or 'not measured'}"


def verdict(findings: Sequence[Finding]) -> Verdict:
    """All statements hold: reproduced; some: in part; none: not, or open if one of them is.

    Where a group of statements was not measured, the claim is reproduced in part at best.
    """
    checks = [check for finding in findings for check in finding.checks]
    if not checks:
        return "not measured"
    if all(check.holds for check in checks) and all(finding.checks for finding in findings):
        return "reproduced"
    if any(check.holds for check in checks):
        return "reproduced in part"
    return "left open" if any(check.open for check in checks) else "not reproduced"


def about(value: float, target: float) -> bool:
    """Whether a value is the target, give or take a fifth of it."""
    return abs(value - target) <= ABOUT * abs(target)


def symbol(results: Results, place: float) -> str:
    """`K = 3`, held together."""
    return at_place(results, place).replace(" ", NO_BREAK)


def at_each_place(
    results: Results,
    what: str,
    check: Callable[[float], Check | None],
    places: Sequence[float] | None = None,
) -> Finding:
    """A statement at each place on the axis; places where nothing was measured are left out."""
    found = [check(place) for place in (results.places() if places is None else places)]
    return Finding(what, tuple(c for c in found if c is not None))


def pairs(
    results: Results,
    metric: str,
    first: str,
    second: str,
    places: Sequence[float] | None = None,
) -> list[tuple[float, Measured, Measured]]:
    """A metric of two series, at every place where both were measured."""

    def measure(series: str, place: float) -> Measured | None:
        return results.measured(series, place, metric)

    return paired(results, measure, first, second, places)


def paired(
    results: Results,
    measure: Callable[[str, float], Measured | None],
    first: str,
    second: str,
    places: Sequence[float] | None = None,
) -> list[tuple[float, Measured, Measured]]:
    """As `pairs`, of whatever `measure` finds for a series and a place."""
    found = []
    for place in results.places() if places is None else places:
        a, b = measure(first, place), measure(second, place)
        if a is not None and b is not None:
            found.append((place, a, b))
    return found


def lower(
    results: Results,
    metric: str,
    first: str,
    second: str,
    places: Sequence[float] | None = None,
) -> Finding:
    """The first series has less of a metric than the second, by the interval of the ratio."""
    shares = pairs(results, metric, first, second, places)
    return less(results, f"{first} below {second} by", shares)


def less(
    results: Results, what: str, measured: Sequence[tuple[float, Measured, Measured]]
) -> Finding:
    """Whether, in each pair, the first is less than the second, by the interval of the ratio."""
    checks = []
    for place, a, b in measured:
        share = reduction(a, b)
        checks.append(Check.positive(f"{symbol(results, place)}: {percent(share)}", share))
    return Finding(what, tuple(checks))


def higher(
    results: Results, metric: str, first: str, second: str, digits: int, unit: str = ""
) -> Finding:
    """The first series has more of a metric than the second, by the interval of the difference."""
    checks = []
    for place, a, b in pairs(results, metric, first, second):
        more = difference(a, b)
        text = f"{symbol(results, place)}: {number(more, digits, unit)}"
        checks.append(Check.positive(text, more))
    return Finding(f"{first} above {second} by", tuple(checks))


def within(
    results: Results,
    metric: str,
    series: str,
    bounds: tuple[float, float],
    what: str,
    digits: int,
    unit: str = "",
    places: Sequence[float] | None = None,
) -> Finding:
    """The mean of a metric lies within bounds; open where only its interval reaches them."""
    low, high = bounds

    def check(place: float) -> Check | None:
        measured = results.measured(series, place, metric)
        if measured is None:
            return None
        estimate = measured.estimate
        text = f"{symbol(results, place)}: {number(estimate, digits, unit)}"
        holds = low <= estimate.mean <= high
        reaches = estimate.low <= high and estimate.high >= low
        return Check(text, holds, open=not holds and reaches)

    return at_each_place(results, f"{series} {what}", check, places)
