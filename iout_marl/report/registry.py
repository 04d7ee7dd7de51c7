"""Reports by the name that a study gives, `report: plain`: a function from results to a `Report`.

A report of your own is registered from your own file, and named by your study:

    from iout_marl.report import Report, reports

    @reports.register("short")
    def short_report(results):
        return Report(results.title, lead=("…",), facts=(), sections=())

    iout reproduce --study mine.yaml --import my_reports
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING

from iout_marl.errors import InputError
from iout_marl.outside import load_entry_points
from iout_marl.registry import Entry, Registry

if TYPE_CHECKING:
    from iout_marl.report.document import Report
    from iout_marl.study.results import Results

#: The reports, by their names.
reports: Registry[Callable[[Results], Report]] = Registry("report", in_scenarios=False)
#: Modules of this package that register reports. They are imported when a report is asked for:
#: they build upon this one.
_BUNDLED = ("iout_marl.report.generic", "iout_marl.paper")


def report_named(name: str) -> Entry[Callable[[Results], Report]]:
    """The report of a name, be it of this package or from outside.

    Raises:
        InputError: there is none.
    """
    _register_all()
    try:
        return reports[name]
    except InputError as error:
        raise InputError(f"{error} (--import brings in reports of your own)") from None


@cache
def _register_all() -> None:
    for module in _BUNDLED:
        importlib.import_module(module)
    load_entry_points()
