"""Where cells are: in metres from cell (1, 1, 1), and on Earth."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from iout_marl.extras import require
from iout_marl.scenario.sections import Grid

Floats = npt.NDArray[np.float64]


class Place:
    """The place of a grid.

    Local metres are (x, y, depth): x and y from the centre of cell (1, 1, 1) along the grid's axes,
    depth below the surface. Without an origin depth counts from the uppermost layer's centre.

    Args:
        grid: the section of a scenario.

    Attributes:
        spacing_m: as the scenario has it: a number, or three.
        edges_m: (3,) edges of a cell along x, y and z.
    """

    def __init__(self, grid: Grid) -> None:
        self.spacing_m = grid.spacing_m
        self.edges_m = np.array(grid.edges_m)
        self.shape = grid.cells
        self.origin = grid.origin
        self._top_m = grid.origin.depth_m if grid.origin else 0.0
        bearing = math.radians(grid.origin.bearing_deg if grid.origin else 0.0)
        self._cos, self._sin = math.cos(bearing), math.sin(bearing)

    def local(self, cells: npt.ArrayLike) -> Floats:
        """(…, 3) local metres of the centres of (…, 3) cells, counted from 1."""
        metres = (np.asarray(cells, dtype=np.float64) - 1) * self.edges_m
        return metres + np.array([0.0, 0.0, self._top_m])

    def cells(self, local: npt.ArrayLike) -> npt.NDArray[np.int64]:
        """(…, 3) cells in which (…, 3) local metres lie, from 1 where they are in the grid."""
        metres = np.asarray(local, dtype=np.float64) - np.array([0.0, 0.0, self._top_m])
        # A position between two cells is of the one with the higher number, on every axis.
        return np.floor(metres / self.edges_m + 0.5).astype(np.int64) + 1

    def east_north(self, local: npt.ArrayLike) -> Floats:
        """(…, 3) metres to the east and north of the origin, and depth."""
        x, y, depth = np.moveaxis(np.asarray(local, dtype=np.float64), -1, 0)
        return np.stack(
            [x * self._cos + y * self._sin, y * self._cos - x * self._sin, depth], axis=-1
        )

    def geodetic(self, local: npt.ArrayLike) -> Floats:
        """(…, 3) latitudes and longitudes in degrees, and depths in m, of (…, 3) local metres.

        East and north are those of the plane that touches the ellipsoid in the origin, so
        distances from the origin and directions there are exact (azimuthal equidistant).

        Raises:
            InputError: pyproj is not installed.
            ValueError: the grid has no origin.
        """
        origin = self._placed()
        east, north, depth = np.moveaxis(self.east_north(local), -1, 0)
        azimuth_deg = np.degrees(np.arctan2(east, north))
        latitude, longitude = np.full_like(east, origin[0]), np.full_like(east, origin[1])
        found = _geod().fwd(longitude, latitude, azimuth_deg, np.hypot(east, north))
        return np.stack([found[1], found[0], depth], axis=-1)

    def from_geodetic(self, geodetic: npt.ArrayLike) -> Floats:
        """(…, 3) local metres of (…, 3) latitudes and longitudes in degrees, and depths in m.

        Raises:
            InputError, ValueError: as for `geodetic`.
        """
        origin = self._placed()
        latitude, longitude, depth = np.moveaxis(np.asarray(geodetic, dtype=np.float64), -1, 0)
        start = np.full_like(longitude, origin[1]), np.full_like(latitude, origin[0])
        azimuth_deg, _, distance = _geod().inv(*start, longitude, latitude)
        east = distance * np.sin(np.radians(azimuth_deg))
        north = distance * np.cos(np.radians(azimuth_deg))
        x = east * self._cos - north * self._sin
        y = east * self._sin + north * self._cos
        return np.stack([x, y, depth], axis=-1)

    def _placed(self) -> tuple[float, float]:
        if self.origin is None:
            raise ValueError("the grid has no origin")
        return self.origin.latitude_deg, self.origin.longitude_deg


def distances_m(geodetic: npt.ArrayLike) -> Floats:
    """(points − 1,) horizontal distances between successive (points, ≥ 2) latitudes, longitudes."""
    latitude, longitude = np.asarray(geodetic, dtype=np.float64)[:, :2].T
    found: Floats = np.asarray(
        _geod().inv(longitude[:-1], latitude[:-1], longitude[1:], latitude[1:])[2]
    )
    return found


def _geod() -> Any:
    """The ellipsoid."""
    require("grid.origin", "mission")
    from pyproj import Geod

    return Geod(ellps="WGS84")
