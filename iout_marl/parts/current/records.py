"""Currents in files: NetCDF of ocean models, and CSV, as velocities over time, depth and place."""

from __future__ import annotations

import io
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from iout_marl.core.grid import Floats
from iout_marl.errors import InputError, did_you_mean
from iout_marl.extras import require
from iout_marl.scenario.data_files import DataFile
from iout_marl.scenario.data_readers import listed_on_axes, read_csv
from iout_marl.scenario.places import shorten

#: What the columns, variables and coordinates of a record are called: by HYCOM, by Copernicus, and
#: by others.
EAST = ("water_u", "uo", "u", "eastward_sea_water_velocity")
NORTH = ("water_v", "vo", "v", "northward_sea_water_velocity")
TIME, DEPTH = ("time_s", "time"), ("depth_m", "depth")
LATITUDE, LONGITUDE = ("lat", "latitude"), ("lon", "longitude")
X, Y = ("x_m", "x"), ("y_m", "y")
_KNOWN = {*EAST, *NORTH, *TIME, *DEPTH, *LATITUDE, *LONGITUDE, *X, *Y}
#: The fastest current that is believed: that of tidal races.
FASTEST_M_PER_S = 5.0


class Record(NamedTuple):
    """Velocities on axes, each the lowest first.

    Attributes:
        file: where they were.
        times_s: seconds from the first field.
        depths_m: below the surface; empty where the file has none, and all depths are alike.
        places: latitudes and longitudes in degrees, or y and x in the grid's metres.
        is_geographic: which of the two.
        velocity_m_per_s: (times, depths, latitudes, longitudes, 2) to the east and to the north;
            not a number on land.
    """

    file: DataFile
    times_s: Floats
    depths_m: Floats
    places: tuple[Floats, Floats]
    is_geographic: bool
    velocity_m_per_s: Floats


@lru_cache(maxsize=4)
def read_record(file: DataFile) -> Record:
    """The velocities of a file.

    Raises:
        InputError: it is none of such a file, lacks something, or its numbers are no currents.
    """
    if file.name.lower().endswith(".csv"):
        record = _from_csv(file)
    elif file.contents[:3] == b"CDF" or file.contents[:4] == b"\x89HDF":
        record = _from_netcdf(file)
    else:
        raise file.fault("is neither a CSV file, by its name, nor NetCDF, by its contents")
    velocity = record.velocity_m_per_s
    if np.isnan(velocity).any(axis=-1).all():
        raise file.fault("holds no velocity: all are NaN")
    fastest = float(np.nanmax(np.abs(velocity)))
    if fastest > FASTEST_M_PER_S:
        slips = ((100, "cm/s"), (1000, "mm/s"))
        meant = [unit for by, unit in slips if fastest / by <= FASTEST_M_PER_S]
        hint = f" (are these {meant[0]}?)" if meant else ""
        raise file.fault(
            f"velocities of up to {fastest:.3g} m/s are implausible: usual are 0 to "
            f"{FASTEST_M_PER_S:g} m/s{hint}"
        )
    return record


def _from_csv(file: DataFile) -> Record:
    columns = read_csv(file, allow_nan=True)
    east, north = (_named(file, columns, names) for names in (EAST, NORTH))
    time, depth = (_named(file, columns, names, optional=True) for names in (TIME, DEPTH))
    is_geographic = any(name in columns for name in (*LATITUDE, *LONGITUDE))
    across = (LATITUDE, LONGITUDE) if is_geographic else (Y, X)
    places = [_named(file, columns, names) for names in across]
    axes = tuple(name for name in (time, depth, *places) if name)
    for name in axes:
        if np.isnan(columns[name]).any():
            raise file.fault(f"{name}: must not be NaN")
    values, lines = listed_on_axes(file, axes, columns)
    found = dict(zip(axes, values, strict=True))
    velocity = np.stack([columns[east][lines], columns[north][lines]], axis=-1)
    return _record(file, found, velocity, (time, depth, *places), is_geographic)


def _from_netcdf(file: DataFile) -> Record:
    require("a current from NetCDF", "currents", "xarray", "h5netcdf", "h5py")
    import xarray

    engine = "scipy" if file.contents[:3] == b"CDF" else "h5netcdf"
    try:
        with xarray.open_dataset(io.BytesIO(file.contents), engine=engine) as data:
            return _from_dataset(file, data)
    except InputError:
        raise
    except Exception as error:  # what is raised on a damaged file depends on the damage
        raise file.fault(f"is no NetCDF file, or a damaged one: {shorten(str(error))}") from None


def _from_dataset(file: DataFile, data: Any) -> Record:
    names = [*map(str, data.data_vars)]
    east, north = (data[_named(file, names, each, "variable")] for each in (EAST, NORTH))
    dims = [*map(str, east.dims)]
    if set(east.dims) != set(north.dims):
        raise file.fault(f"{east.name} and {north.name} must have the same dimensions")
    time, depth = (
        _named(file, dims, each, "dimension", optional=True) for each in (("time",), DEPTH)
    )
    is_geographic = any(name in dims for name in (*LATITUDE, *LONGITUDE))
    across = (LATITUDE, LONGITUDE) if is_geographic else (Y, X)
    places = [_named(file, dims, each, "dimension") for each in across]
    axes = tuple(name for name in (time, depth, *places) if name)
    if others := [name for name in dims if name not in axes]:
        raise file.fault(f"{east.name}: has a dimension {others[0]!r}, which no current has here")
    velocity = np.stack(
        [each.transpose(*axes).to_numpy().astype(np.float64) for each in (east, north)], axis=-1
    )
    found = {name: _axis(file, name, data, is_time=name == time) for name in axes}
    for i, name in enumerate(axes):
        order = found[name].argsort(kind="stable")
        found[name], velocity = found[name][order], velocity.take(order, axis=i)
        if not (np.diff(found[name]) > 0).all():
            raise file.fault(f"{name}: has a value twice")
    return _record(file, found, velocity, (time, depth, *places), is_geographic)


def _axis(file: DataFile, name: str, data: Any, *, is_time: bool) -> Floats:
    """The values of a coordinate; of time in seconds."""
    if name not in data.coords:
        raise file.fault(f"dimension {name!r} has no coordinate of its name")
    values = data.coords[name].to_numpy()
    if is_time and values.dtype.kind in "mM":
        return (values - values[0]) / np.timedelta64(1, "s")
    if is_time:
        raise file.fault(f"{name}: must have units such as 'hours since 2024-01-01'")
    if values.dtype.kind not in "fiu" or not np.isfinite(values).all():
        raise file.fault(f"{name}: must be finite numbers")
    found: Floats = values.astype(np.float64)
    return found


def _record(
    file: DataFile,
    found: dict[str, Floats],
    velocity: Floats,
    names: Sequence[str],
    is_geographic: bool,  # noqa: FBT001
) -> Record:
    time, depth, *places = names
    times_s = found[time] - found[time][0] if time else np.zeros(1)
    depths_m = found[depth] if depth else np.zeros(0)
    first, second = (found[name] for name in places)
    shape = (len(times_s), max(len(depths_m), 1), len(first), len(second), 2)
    return Record(file, times_s, depths_m, (first, second), is_geographic, velocity.reshape(shape))


def _named(
    file: DataFile,
    there: Any,
    names: Sequence[str],
    what: str = "column",
    *,
    optional: bool = False,
) -> str:
    """Which of some names a file has; "" for none where that may be."""
    name = next((name for name in names if name in there), "")
    if not name and not optional:
        unread = [each for each in there if each not in _KNOWN]
        near = next(filter(None, (did_you_mean(n, unread, or_list=False) for n in names)), "")
        has = near or f"; it has {', '.join(map(shorten, there)) or 'none'}"
        raise file.fault(f"has no {what} {' or '.join(names[:3])}{has}")
    return name
