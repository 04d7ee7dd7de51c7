"""The paper that this software reproduces: its claims, tables, figures and printed numbers.

A client of the library: importing it registers the report `paper`, and nothing else in
`iout_marl` imports it.
"""

from iout_marl.paper.report import paper_report
from iout_marl.report.registry import reports

__all__ = ["paper_report"]

reports.register("paper")(paper_report)
