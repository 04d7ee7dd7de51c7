"""Files of currents that tests give to scenarios."""

import itertools

from iout_marl.scenario.data_files import DataFile

ORIGIN = {"latitude_deg": 60.2, "longitude_deg": 5.1, "depth_m": 4.0, "bearing_deg": 35.0}


def csv_file(times_s, depths_m, xs_m, ys_m, velocity, *, name="flow.csv", places=("x_m", "y_m")):
    """A CSV file of velocities to the east and north, by a function of time, depth, x and y."""
    lines = [f"time_s,depth_m,{places[0]},{places[1]},u,v"]
    lines += [
        ",".join(f"{each!r}" for each in (*point, *velocity(*point)))
        for point in itertools.product(times_s, depths_m, xs_m, ys_m)
    ]
    return DataFile(name, "\n".join(lines).encode())


def uneven(t, z, x, y):
    """To the east and north in m/s: another number at every point."""
    return 0.9 + x / 900 - t / 9000 - y * z / 2e5, 0.3 - y / 400 + (x - 2 * z) / 1500 + t / 8000


#: A file that reaches beyond the cells of the tests' grids, and beyond their episodes.
WIDE = csv_file([0.0, 1500.0, 7000.0], [0.0, 50.0, 900.0], [-50.0, 330.0, 900.0], [-9, 950], uneven)
