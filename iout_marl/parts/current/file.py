"""Currents from files, such as ocean models write."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import numpy.typing as npt

from iout_marl.core.current import Frames
from iout_marl.core.geography import Place
from iout_marl.core.grid import Floats, Grid
from iout_marl.core.interpolation import interpolated
from iout_marl.errors import InputError
from iout_marl.parts.current.base import Current, check_size, currents, middles_s
from iout_marl.parts.current.records import Record, read_record
from iout_marl.scenario import Scenario
from iout_marl.scenario.data_files import DataFile
from iout_marl.scenario.fields import NonNegative, Plausible, invalid
from iout_marl.scenario.parts import Settings as PartSettings

#: By how much cells may lie beyond a file, in metres: what roundings come to.
_SLACK_M = 0.01
#: A degree of latitude, for messages.
_DEGREE_M = 111_200.0


@currents.register("file")
class FromFile(Current):
    """Velocities to the east and north from a file, over time, depth and place.

    A NetCDF file has variables `water_u`, `water_v` (HYCOM), `uo`, `vo` (Copernicus) or `u`, `v`
    over `time`, `depth`, `lat` or `latitude`, `lon` or `longitude`. A CSV file has columns `u`,
    `v`, `latitude`, `longitude` (or `x_m`, `y_m` in the grid's metres), and `time_s`, `depth_m`
    where it tells them apart, with a line for every combination. Between its points velocities are
    interpolated linearly in place, depth and time; above its uppermost depth holds that one's. They
    are turned by `grid.origin.bearing_deg`.
    """

    class Settings(PartSettings):
        #: The file, NetCDF or CSV.
        file: DataFile
        #: Time after the file's first field at which an episode begins.
        start_h: Annotated[NonNegative, Plausible(0, 1e5, "h")] = 0.0
        #: Whether the file begins anew where it ends, as a cycle of the tide does: its last field
        #: then stands for the first.
        repeats: bool = False

    settings: Settings
    reads_origin = True

    def check(self, scenario: Scenario) -> None:
        if scenario.grid.origin is None:
            raise invalid(
                ("current",),
                "'file' needs grid.origin, by which the file's places and depths are found",
                beside=("grid",),
            )
        super().check(scenario)

    def frames(self, scenario: Scenario) -> Frames:
        try:
            record = read_record(self.settings.file)
            times_s, frame, weight = self._times(record, scenario)
            check_size(len(times_s), scenario)
            places = Place(scenario.grid)
            points = _points(record, places, scenario)
            used = record.velocity_m_per_s[times_s]
            velocity = _at(record, np.moveaxis(used, 0, -2), points)
            _check_no_land(record, velocity, scenario)
        except InputError as error:
            raise invalid(("current", "file"), str(error)) from None
        bearing = np.radians(places.origin.bearing_deg if places.origin else 0.0)
        # Frames first.
        east, north = np.moveaxis(velocity.swapaxes(0, 1), -1, 0)
        cos, sin = np.cos(bearing), np.sin(bearing)
        along = np.stack([east * cos - north * sin, east * sin + north * cos], axis=-1)
        return Frames(along, frame, weight) if len(along) > 1 else Frames.from_steady(along[0])

    def _times(
        self, record: Record, scenario: Scenario
    ) -> tuple[list[int], npt.NDArray[np.int64], Floats]:
        """Which fields are needed, and between which of them each slot lies, as `Frames` has it.

        Raises:
            InputError: the file does not cover the episode.
        """
        known_s = record.times_s
        if len(known_s) == 1:
            return [0], np.zeros(0, dtype=np.int64), np.zeros(0)
        at_s = middles_s(scenario) + 3600 * self.settings.start_h
        if self.settings.repeats:
            at_s = at_s % known_s[-1]
        if at_s[-1] > known_s[-1] and not self.settings.repeats:
            raise record.file.fault(
                f"covers {known_s[-1] / 3600:.4g} h, but the episode takes it to "
                f"{at_s[-1] / 3600:.4g} h; a cycle may go on with repeats: true"
            )
        place = np.clip(np.searchsorted(known_s, at_s, side="right") - 1, 0, len(known_s) - 2)
        weight = (at_s - known_s[place]) / (known_s[place + 1] - known_s[place])
        first, last = int(place.min()), int(place.max()) + 1
        return list(range(first, last + 1)), place - first, np.clip(weight, 0.0, 1.0)


def _points(record: Record, place: Place, scenario: Scenario) -> tuple[Floats, ...]:
    """Depths, latitudes and longitudes (or y and x) of the centres of all cells.

    Raises:
        InputError: the record does not reach them all.
    """
    local = place.local(Grid.from_scenario(scenario).all_coordinates() + 1)
    first_at, second_at, depth = local[:, 1], local[:, 0], local[:, 2]
    first, second = record.places
    units_m, names = (1.0, 1.0), ("y", "x")
    sides = (("−y", "+y"), ("−x", "+x"))
    if record.is_geographic:
        first_at, second_at, _ = place.geodetic(local).T
        # As the file counts longitudes, from 0 to 360 say.
        second_at = second_at + 360 * np.round((second.mean() - second_at.mean()) / 360)
        units_m = (_DEGREE_M, _DEGREE_M * float(np.cos(np.radians(first_at.mean()))))
        names, sides = ("latitude", "longitude"), (("south", "north"), ("west", "east"))
    across = zip((first, second), (first_at, second_at), names, sides, units_m, strict=True)
    for values, at, name, (below, above), unit_m in across:
        _check_covers(record, values, at, name, (below, above), unit_m)
    if not len(record.depths_m):
        return np.zeros(len(depth)), first_at, second_at
    deepest, last = float(depth.max()), float(record.depths_m[-1])
    if last < deepest - _SLACK_M:
        is_km = " (are these km?)" if deepest / 1000 <= last < deepest / 20 else ""
        raise record.file.fault(
            f"depths reach down to {last:g} m{is_km}, but cells of the grid to {deepest:g} m"
        )
    return depth, first_at, second_at


def _check_covers(
    record: Record, values: Floats, at: Floats, name: str, sides: tuple[str, str], unit_m: float
) -> None:
    """Refuse a record that does not reach all cells along an axis."""
    for side, missing, edge, cell in (
        (sides[0], values[0] - at.min(), values[0], at.min()),
        (sides[1], at.max() - values[-1], values[-1], at.max()),
    ):
        if missing * unit_m > _SLACK_M:
            raise record.file.fault(
                f"does not cover the grid towards {side}: it ends at {name} {edge:.7g}, cells "
                f"reach to {cell:.7g}, {missing * unit_m:,.0f} m farther"
            )


def _at(record: Record, table: Floats, points: tuple[Floats, ...]) -> Floats:
    """(cells, frames, 2) velocities of a (depths, latitudes, longitudes, frames, 2) table."""
    depths_m = record.depths_m if len(record.depths_m) else np.zeros(1)
    return interpolated((depths_m, *record.places), table, points)


def _check_no_land(record: Record, velocity: Floats, scenario: Scenario) -> None:
    """Refuse cells in which there is no velocity."""
    is_land = np.isnan(velocity).any(axis=(1, 2))
    if is_land.any():
        cells = Grid.from_scenario(scenario).all_coordinates() + 1
        cell = cells[is_land.argmax()].tolist()
        raise record.file.fault(
            f"has no velocity (NaN, as on land) at {int(is_land.sum()):,} of {len(cells):,} cells "
            f"of the grid, the first of them {cell}"
        )
