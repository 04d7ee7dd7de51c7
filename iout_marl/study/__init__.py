"""Studies: grids of scenarios, policies and seeds, run in parallel, kept on disk."""

from iout_marl.study.cells import Cell, expand
from iout_marl.study.results import CellResult, Results
from iout_marl.study.run import run_study
from iout_marl.study.schema import Study, load_study

__all__ = [
    "Cell",
    "CellResult",
    "Results",
    "Study",
    "expand",
    "load_study",
    "run_study",
]
