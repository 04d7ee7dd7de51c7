"""The committed results of studies, for the tables of pages."""

from __future__ import annotations

import functools
from pathlib import Path

from iout_marl.study.results import Results, read_results

HERE = Path(__file__).parent


@functools.cache
def results_of(study: str) -> Results:
    """The committed results of a study."""
    return read_results(HERE / study / "results.json")
