"""From results to a report."""

from __future__ import annotations

import numpy as np

from iout_marl.report.content import Report
from iout_marl.report.intake import take_in
from iout_marl.report.paper import paper_report
from iout_marl.report.plain import plain_report
from iout_marl.study.results import Results


def build_report(results: Results) -> Report:
    """The report of the kind that the study names."""
    results = take_in(results)
    # Figures of any size are figures: what overflows is shown as a dash.
    with np.errstate(all="ignore"):
        return paper_report(results) if results.report == "paper" else plain_report(results)
