"""Makes `bay_currents.nc`: a tidal current with eddies where the bay of `sea/bay` lies.

    python scenarios/data/bay_currents.py

None of it was measured. A tidal ellipse of 0.3 m/s by 0.08 m/s along the north-east, which falls
off towards the floor, and two eddies that drift through within a tide; hourly fields of one tide of
12.42 h, so that it may be repeated. Variables are called as those of Copernicus are.
"""

from pathlib import Path

import numpy as np
import xarray as xr

LATITUDE, LONGITUDE = np.linspace(36.845, 36.861, 9), np.linspace(-121.885, -121.861, 13)
DEPTH_M, TIDE_H = np.array([0.0, 10.0, 25.0, 45.0, 70.0]), 12.42
HOURS = np.linspace(0.0, TIDE_H, 13)
#: Strength at the surface along and across the ellipse, its direction from north, eddies.
ALONG, ACROSS, TOWARD_DEG = 0.3, 0.08, 40.0
#: Circulation in m²/s, radius in m, centre east and north of the middle in m.
EDDIES = ((120.0, 250.0, -350.0, 150.0), (-90.0, 200.0, 400.0, -200.0))


def velocity(hour, depth_m, east_m, north_m):
    """East and north in m/s; the same at the end of a tide as at its beginning."""
    phase = 2 * np.pi * hour / TIDE_H
    fall = (1 - depth_m / 90) ** (1 / 7) * np.exp(-depth_m / 150)
    along, across, angle = ALONG * np.cos(phase), ACROSS * np.sin(phase), np.radians(TOWARD_DEG)
    u = fall * (along * np.sin(angle) + across * np.cos(angle))
    v = fall * (along * np.cos(angle) - across * np.sin(angle))
    for circulation, radius, east, north in EDDIES:
        # Round a circle within the tide.
        x, y = east + 120 * np.cos(phase), north + 120 * np.sin(phase)
        squared = (east_m - x) ** 2 + (north_m - y) ** 2 + 1.0
        turn = circulation / (2 * np.pi * squared) * -np.expm1(-squared / radius**2) * fall
        u, v = u - turn * (north_m - y), v + turn * (east_m - x)
    return u, v


def main():
    hour, depth, latitude, longitude = np.meshgrid(
        HOURS, DEPTH_M, LATITUDE, LONGITUDE, indexing="ij"
    )
    north = (latitude - LATITUDE.mean()) * 111_200
    east = (longitude - LONGITUDE.mean()) * 111_200 * np.cos(np.radians(LATITUDE.mean()))
    axes = ("time", "depth", "latitude", "longitude")
    names = ("eastward_sea_water_velocity", "northward_sea_water_velocity")
    fields = zip(("uo", "vo"), velocity(hour, depth, east, north), names, strict=True)
    data = xr.Dataset(
        {
            name: (axes, field.astype(np.float32), {"units": "m s-1", "standard_name": long})
            for name, field, long in fields
        },
        {
            "time": ("time", HOURS, {"units": "hours since 2024-06-01"}),
            "depth": ("depth", DEPTH_M, {"units": "m", "positive": "down"}),
            "latitude": ("latitude", LATITUDE, {"units": "degrees_north"}),
            "longitude": ("longitude", LONGITUDE, {"units": "degrees_east"}),
        },
        {"title": "Assumed currents of a bay", "source": "bay_currents.py; nothing was measured"},
    )
    packed = {"dtype": "int16", "scale_factor": 1e-4, "_FillValue": -32768, "zlib": True}
    data.to_netcdf(
        Path(__file__).with_suffix(".nc"),
        engine="h5netcdf",
        encoding={"uo": packed, "vo": packed},
    )


if __name__ == "__main__":
    main()
