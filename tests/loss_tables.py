"""Tables of transmission loss for tests, by formulas of their own."""

from __future__ import annotations

import io
import itertools
from collections.abc import Iterable, Sequence

import numpy as np

from iout_marl.parts import DataFile

RANGES_M, DEPTHS_M = (20.0, 90.0, 300.0, 1400.0), (5.0, 60.0, 330.0)


def csv_file(lines: Iterable[Sequence[float]], names: Sequence[str], name: str) -> DataFile:
    rows = [",".join(names), *(",".join(map(repr, line)) for line in lines)]
    return DataFile(name, "\n".join(rows).encode())


def by_range_and_depth(frequencies_khz, ranges_m=RANGES_M, depths_m=DEPTHS_M, name="loss.csv"):
    """A list by range and depths, in which the AUV's depth matters more than the node's."""
    names = ("frequency_khz", "range_m", "auv_depth_m", "node_depth_m", "loss_db")
    lines = [
        (f, r, a, n, float(20 * np.log10(r) + 0.01 * f * r / 100 + 0.03 * a + 0.01 * n))
        for f, r, a, n in itertools.product(frequencies_khz, ranges_m, depths_m, depths_m)
    ]
    return csv_file(lines, names, name)


def by_cells(frequencies_khz, cells, name="cells.csv"):
    """A list for every pair of cells, of no reciprocity and no symmetry."""
    names = (
        *("frequency_khz", "auv_x", "auv_y", "auv_z"),
        *("node_x", "node_y", "node_z", "loss_db"),
    )
    own = [range(1, size + 1) for size in cells]
    rng = np.random.default_rng(7)
    lines = [
        (
            f,
            *cell,
            round(
                float(
                    30
                    + 15 * np.log10(1 + np.abs(np.subtract(cell[:3], cell[3:])).sum())
                    + rng.uniform(0, 6)
                ),
                3,
            ),
        )
        for f in frequencies_khz
        for cell in itertools.product(*own, *own)
    ]
    return csv_file(lines, names, name)


def as_npz(**arrays):
    """A file that `numpy.savez` writes."""
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return DataFile("loss.npz", stream.getvalue())


def on_disk(settings, folder):
    """Settings with the paths of files of data, as a scenario would write them."""

    def written(value):
        if isinstance(value, list):
            return [written(each) for each in value]
        if not isinstance(value, DataFile):
            return value
        (folder / value.name).write_bytes(value.contents)
        return str(folder / value.name)

    return {key: written(value) for key, value in settings.items()}
