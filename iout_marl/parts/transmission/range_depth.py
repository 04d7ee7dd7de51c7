"""Transmission loss by range and depths, from tables that other tools have made."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from iout_marl.core.grid import Floats, Grid
from iout_marl.core.interpolation import interpolated
from iout_marl.core.pairs import MAX_PAIRS, Pairs
from iout_marl.errors import InputError
from iout_marl.parts.transmission.base import Transmission, refuse, transmissions
from iout_marl.parts.transmission.tables import LossTable, table_at
from iout_marl.scenario import Scenario
from iout_marl.scenario.data_files import DataFile
from iout_marl.scenario.fields import Depth
from iout_marl.scenario.parts import Settings as PartSettings

_AXES = ("range_m", "auv_depth_m", "node_depth_m")
#: By how many metres a cell may lie beyond a table: what roundings come to.
_SLACK_M = 1e-6


@transmissions.register("range_depth")
class RangeDepth(Transmission):
    """Loss by horizontal range, depth of the AUV and depth of the node, from tables.

    A table has the axes frequency_khz, range_m, auv_depth_m and node_depth_m, and loss_db. Between
    its points dB are interpolated linearly, over the depths and over the logarithm of the range.
    """

    class Settings(PartSettings):
        #: Files, CSV or npz, that have a table at each of the scenario's frequencies.
        tables: Annotated[tuple[DataFile, ...], Field(strict=False, min_length=1, max_length=20)]
        #: Depth below the surface of the uppermost layer's centre; null for that of `grid.origin`.
        top_depth_m: Depth | None = None

    settings: Settings

    @property
    def reads_origin(self) -> bool:  # type: ignore[override]
        return self.settings.top_depth_m is None

    def check(self, scenario: Scenario) -> None:
        grid = Grid.from_scenario(scenario)
        if (count := Pairs.count_of_layers(grid)) > MAX_PAIRS:
            raise refuse(
                f"the grid makes {count:,} pairs of cells; at most {MAX_PAIRS:,}",
                beside=("grid", "cells"),
            )
        if self.settings.top_depth_m is None and scenario.grid.origin is None:
            raise refuse(
                "is needed where there is no grid.origin: tables go by depths", key="top_depth_m"
            )
        duplex = scenario.duplex.part
        pairs = Pairs.from_layers(grid)
        for khz in {duplex.charging_frequency_khz, duplex.uplink_frequency_khz}:
            try:
                table = self._table(khz)
            except InputError as error:
                raise refuse(str(error)) from None
            try:
                self._check_covers(scenario, table, pairs)
            except InputError as error:
                raise refuse(str(error), beside=("grid", "cells")) from None

    def pairs(self, grid: Grid) -> Pairs:
        return Pairs.from_layers(grid)

    def loss_db(self, scenario: Scenario, pairs: Pairs, frequency_khz: float) -> Floats:
        table = self._table(frequency_khz)
        ranges_m, auv_depths_m, node_depths_m = table.axes
        top_m, edge_m = self._top_m(scenario), pairs.grid.edges_m[2]
        points = (
            np.log(np.maximum(pairs.range_m, ranges_m[0])),
            top_m + pairs.auv_cells[:, 2] * edge_m,
            top_m + pairs.node_cells[:, 2] * edge_m,
        )
        return interpolated((np.log(ranges_m), auv_depths_m, node_depths_m), table.loss_db, points)

    def _table(self, frequency_khz: float) -> LossTable:
        return table_at(self.settings.tables, _AXES, frequency_khz, counted=False)

    def _top_m(self, scenario: Scenario) -> float:
        own_m: float | None = self.settings.top_depth_m
        if own_m is None:
            assert scenario.grid.origin is not None  # or it has been refused
            own_m = scenario.grid.origin.depth_m
        return own_m

    def _check_covers(self, scenario: Scenario, table: LossTable, pairs: Pairs) -> None:
        """See that a table reaches all cells of the grid.

        Raises:
            InputError: it does not.
        """
        x_m, y_m, z_m = pairs.grid.edges_m
        ranges_m, *depths_m = table.axes
        farthest_m = float(pairs.range_m.max())
        near_m = min(x_m, y_m) / 2
        if ranges_m[0] <= 0:
            raise table.file.fault("range_m: must be above 0; what is nearer counts as the first")
        if ranges_m[-1] < farthest_m - _SLACK_M:
            seems_km = farthest_m / 1000 <= ranges_m[-1] <= farthest_m / 20
            is_km = " (are these km?)" if seems_km else ""
            raise table.file.fault(
                f"range_m: ends at {ranges_m[-1]:g} m{is_km}, but cells of the grid lie "
                f"{farthest_m:g} m apart"
            )
        if ranges_m[0] > near_m:
            raise table.file.fault(
                f"range_m: begins at {ranges_m[0]:g} m: it must begin within half a cell, "
                f"{near_m:g} m"
            )
        first_m = self._top_m(scenario)
        last_m = first_m + z_m * (pairs.grid.shape[2] - 1)
        for name, values in zip(_AXES[1:], depths_m, strict=True):
            if values[0] > first_m + _SLACK_M or values[-1] < last_m - _SLACK_M:
                raise table.file.fault(
                    f"{name}: reaches from {values[0]:g} to {values[-1]:g} m, but the cells of the "
                    f"grid from {first_m:g} to {last_m:g} m"
                )
