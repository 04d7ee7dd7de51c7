"""From results to a report."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from iout_marl.render.style import COLOURS
from iout_marl.report.document import Report
from iout_marl.report.figure import Plot
from iout_marl.report.intake import take_in
from iout_marl.report.palette import hue
from iout_marl.report.registry import report_named
from iout_marl.study.results import Results

#: Where the name of a series goes on after that of its policy: `tour, TDD`, `greedy (FDD)`.
_AFTER_POLICY = re.compile(r", | \(")


def build_report(results: Results) -> Report:
    """The report that the study names.

    Raises:
        InputError: there is none of that name, or one from outside fails.
    """
    entry = report_named(results.report)
    taken = take_in(results)
    # Figures of any size are figures: what overflows is shown as a dash.
    with np.errstate(all="ignore"), entry.blamed():
        report = entry.item(taken)
    if not isinstance(report, Report):
        raise entry.fault(f"returns {type(report).__name__}, not a Report")
    return _coloured(report, taken)


def _coloured(report: Report, results: Results) -> Report:
    """The same, a series in one colour throughout where its lines have none of their own."""
    plots = [figure for figure in report.figures() if isinstance(figure, Plot)]
    series = set(results.series)
    looks = _looks([[n for line in p.lines if (n := line.name) in series] for p in plots])
    if results.front:  # grey is the front's
        looks = {name: hue(look) for name, look in looks.items()}

    def coloured(plot: Plot) -> Plot:
        lines = (
            replace(line, colour=looks.get(line.name)) if line.colour is None else line
            for line in plot.lines
        )
        return replace(plot, lines=tuple(lines))

    sections = (
        replace(
            section,
            items=tuple(coloured(i) if isinstance(i, Plot) else i for i in section.items),
        )
        for section in report.sections
    )
    return replace(report, sections=tuple(sections))


def _looks(figures: Iterable[list[str]]) -> dict[str, int]:
    """Looks of series, in the order in which they appear: one for each policy, but for those
    that share a figure.

    Args:
        figures: names of the series in each.
    """
    beside: dict[str, set[str]] = defaultdict(set)
    for names in figures:
        for name in names:
            beside[name].update(names)
    looks: dict[str, int] = {}
    of_policy: dict[str, int] = {}
    for name, others in beside.items():
        policy = _AFTER_POLICY.split(name)[0]
        taken = {looks[other] for other in others if other in looks}
        if of_policy.get(policy) in (None, *taken):
            looks[name] = _unused(set(looks.values()), taken)
            of_policy.setdefault(policy, looks[name])
        else:
            looks[name] = of_policy[policy]
    return looks


def _unused(used: set[int], beside: set[int]) -> int:
    """The first look that is not used, if it can be of another colour than those beside it."""
    count = len(COLOURS)
    unused = [look for look in range(len(used) + count) if look not in used]
    colours = {look % count for look in beside}
    return next((look for look in unused if look % count not in colours), unused[0])
