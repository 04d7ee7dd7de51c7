"""From results to a report."""

from __future__ import annotations

import numpy as np

from iout_marl.report.document import Report
from iout_marl.report.intake import take_in
from iout_marl.report.registry import report_named
from iout_marl.study.results import Results


def build_report(results: Results) -> Report:
    """The report that the study names.

    Raises:
        InputError: there is none of that name, or one from outside fails.
    """
    entry = report_named(results.report)
    # Figures of any size are figures: what overflows is shown as a dash.
    with np.errstate(all="ignore"), entry.blamed():
        report = entry.item(take_in(results))
    if not isinstance(report, Report):
        raise entry.fault(f"returns {type(report).__name__}, not a Report")
    return report
