"""From results to a report."""

from __future__ import annotations

from iout_marl.report.content import Report
from iout_marl.report.paper import paper_report
from iout_marl.report.plain import plain_report
from iout_marl.study.results import Results


def build_report(results: Results) -> Report:
    """The report of the kind that the study names."""
    return paper_report(results) if results.report == "paper" else plain_report(results)
