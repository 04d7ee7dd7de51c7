"""Reports of studies: documents of tables and figures, as a page, as Markdown and as pictures.

A study names its report, see `registry`; `document` is what a report is made of.
"""

from iout_marl.report.document import Report, Section, Table
from iout_marl.report.figure import Axis, Line, Plot, TrajectoryPlot
from iout_marl.report.registry import reports

__all__ = ["Axis", "Line", "Plot", "Report", "Section", "Table", "TrajectoryPlot", "reports"]
