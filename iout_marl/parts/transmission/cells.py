"""Transmission loss for every pair of cells, from tables that other tools have made."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from iout_marl.core.grid import Floats, Grid
from iout_marl.core.pairs import MAX_PAIRS, Pairs
from iout_marl.errors import InputError
from iout_marl.parts.transmission.base import Transmission, refuse, transmissions
from iout_marl.parts.transmission.tables import LossTable, table_at
from iout_marl.scenario import Scenario
from iout_marl.scenario.data_files import DataFile
from iout_marl.scenario.parts import Settings as PartSettings

_AXES = ("auv_x", "auv_y", "auv_z", "node_x", "node_y", "node_z")


@transmissions.register("cells")
class Cells(Transmission):
    """Loss between the cell of the AUV and that of the node, from tables.

    A table has loss_db for frequency_khz, auv_x, auv_y, auv_z, node_x, node_y and node_z, the cells
    counted from 1.
    """

    class Settings(PartSettings):
        #: Files, CSV or npz, that have a table at each of the scenario's frequencies.
        tables: Annotated[tuple[DataFile, ...], Field(strict=False, min_length=1, max_length=20)]

    settings: Settings

    def check(self, scenario: Scenario) -> None:
        grid, duplex = Grid.from_scenario(scenario), scenario.duplex.part
        if (count := Pairs.count_of_cells(grid)) > MAX_PAIRS:
            raise refuse(
                f"the grid makes {count:,} pairs of cells; at most {MAX_PAIRS:,}: kind range_depth "
                "takes larger ones",
                beside=("grid", "cells"),
            )
        for khz in {duplex.charging_frequency_khz, duplex.uplink_frequency_khz}:
            try:
                table = self._table(khz)
            except InputError as error:
                raise refuse(str(error)) from None
            try:
                _check_fits(scenario, table)
            except InputError as error:
                raise refuse(str(error), beside=("grid", "cells")) from None

    def pairs(self, grid: Grid) -> Pairs:
        return Pairs.from_cells(grid)

    def loss_db(self, scenario: Scenario, pairs: Pairs, frequency_khz: float) -> Floats:  # noqa: ARG002
        return self._table(frequency_khz).loss_db[(*pairs.auv_cells.T, *pairs.node_cells.T)]

    def _table(self, frequency_khz: float) -> LossTable:
        return table_at(self.settings.tables, _AXES, frequency_khz, counted=True)


def _check_fits(scenario: Scenario, table: LossTable) -> None:
    """See that a table has the cells of the grid, and no others.

    Raises:
        InputError: it does not.
    """
    wanted = scenario.grid.cells * 2
    for name, values, size in zip(_AXES, table.axes, wanted, strict=True):
        if not np.array_equal(values, np.arange(1, size + 1)):
            sizes = [
                " × ".join(str(len(each)) for each in part)
                for part in (table.axes[:3], table.axes[3:])
            ]
            raise table.file.fault(
                f"is of {sizes[0]} cells of AUVs and {sizes[1]} of nodes; the grid has "
                f"{scenario.size_of_grid}, of which {name} must be 1 to {size}"
            )
