"""A table of transmission loss for a shallow sea, and a scenario that goes by it.

By the method of images, which is written out here, or by Bellhop, the ray tracer of the Acoustics
Toolbox. Its executable is in the package aubellhop (Python 3.12 or later), or wherever yours is:

    python examples/transmission_loss.py --out loss.npz
    python examples/transmission_loss.py --out loss.npz --bellhop bellhop.exe
"""

from __future__ import annotations

import argparse
import struct
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from iout_marl import evaluate, load_scenario, physics

#: A sea of one sound speed over sand: m, m/s, kg/m³ by those of water, dB per wavelength.
DEPTH_M, SPEED_M_PER_S = 60.0, 1500.0
SAND_M_PER_S, SAND_DENSITY, SAND_DB_PER_WAVELENGTH = 1650.0, 1.9, 0.8
#: Nodes near the bottom, AUVs in either layer.
SEA = {
    "grid.cells": [8, 8, 2],
    "grid.spacing_m": [50, 50, 30],
    "auvs.speed_m_per_s": 1.5,
    "auvs.start_cells": [[1, 1, 1]],
    "nodes": {"kind": "fixed", "cells": [[2, 3, 2], [7, 2, 2], [5, 7, 2]]},
    "episode.duration_s": 3600,
    "charging": {"power_w": 2000, "efficiency": 0.5, "directivity_index_db": 20},
    "harvester": {"kind": "aperture", "area_m2": 0.02, "efficiency": 0.5},
    "uplink": {
        "kind": "modem",
        "bit_rate_bps": 5000,
        "packet_bits": 2048,
        "bandwidth_hz": 5000,
        "electronics_w": 1.0,
        "maximum_source_level_db": 185,
    },
    "channel": {"kind": "sonar", "spreading_factor": 1.5},
}
TOP_DEPTH_M = 20.0


def bottom_reflection(grazing_rad: np.ndarray) -> np.ndarray:
    """Size of Rayleigh's coefficient of a fluid bottom (Jensen et al., 2011, sec. 1.6)."""
    loss = SAND_DB_PER_WAVELENGTH / (40 * np.pi * np.log10(np.e))
    index = SPEED_M_PER_S / SAND_M_PER_S * (1 + 1j * loss)
    inside = np.sqrt(index**2 - np.cos(grazing_rad) ** 2 + 0j)
    above = SAND_DENSITY * np.sin(grazing_rad)
    return np.abs((above - inside) / (above + inside))


def images_db(khz: float, range_m: np.ndarray, auv_m: float, node_m: float) -> np.ndarray:
    """Loss by images of the source in surface and bottom, their intensities added.

    Image m lies beyond m reflections at each, and up to one more at either of them (Jensen et
    al., 2011, sec. 2.4.4). The surface reflects all.
    """
    alpha_db_per_m = float(physics.thorp_absorption_db_per_km(khz)) / 1000
    intensity = np.zeros_like(range_m)
    for m in range(30):
        for height_m, bounces in (
            (2 * DEPTH_M * m - auv_m + node_m, m),
            (2 * DEPTH_M * (m + 1) - auv_m - node_m, m + 1),
            (2 * DEPTH_M * m + auv_m + node_m, m),
            (2 * DEPTH_M * (m + 1) + auv_m - node_m, m + 1),
        ):
            way_m = np.hypot(range_m, height_m)
            reflected = bottom_reflection(np.arctan2(abs(height_m), range_m)) ** (2 * bounces)
            intensity += reflected * 10 ** (-alpha_db_per_m * way_m / 10) / way_m**2
    return -10 * np.log10(intensity)


def bellhop_db(
    program: str, khz: float, range_m: np.ndarray, auv_m: float, node_depths_m: np.ndarray
) -> np.ndarray:
    """Loss from an AUV's depth by Bellhop, incoherent, for (ranges, nodes' depths)."""
    lines = [
        "'shallow sea'",
        f"{khz * 1000:g}",
        "1",
        "'CVWT'",  # a linear profile, a vacuum above, dB per wavelength, absorption by Thorp
        f"0 0.0 {DEPTH_M}",
        f"0.0 {SPEED_M_PER_S} /",
        f"{DEPTH_M} {SPEED_M_PER_S} /",
        "'A' 0.0",
        f"{DEPTH_M} {SAND_M_PER_S} 0.0 {SAND_DENSITY} {SAND_DB_PER_WAVELENGTH} /",
        "1",
        f"{auv_m} /",
        f"{len(node_depths_m)}",
        " ".join(f"{m}" for m in node_depths_m) + " /",
        f"{len(range_m)}",
        " ".join(f"{m / 1000:.6f}" for m in range_m) + " /",
        "'IB'",  # incoherent, Gaussian beams
        "4000",
        "-89.0 89.0 /",
        f"0.0 {DEPTH_M + 1} {range_m[-1] / 1000 * 1.05}",
    ]
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "sea.env").write_text("\n".join(lines) + "\n")
        subprocess.run([program, "sea"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
        shade = Path(folder) / "sea.shd"
        if not shade.exists():
            raise SystemExit((Path(folder) / "sea.prt").read_text()[-2000:])
        data = shade.read_bytes()
    (words,) = struct.unpack_from("i", data)  # of 4 bytes, in a record
    *_, depths, ranges = struct.unpack_from("7i", data, 2 * 4 * words)
    rows = [np.frombuffer(data, "<c8", ranges, (10 + i) * 4 * words) for i in range(depths)]
    return -20 * np.log10(np.maximum(np.abs(np.array(rows)), 1e-15)).T


def write_table(out: Path, frequencies_khz: list[float], bellhop: str | None) -> None:
    """Write a table that covers the grid."""
    range_m = np.geomspace(10.0, 600.0, 40)
    depth_m = np.array([TOP_DEPTH_M, TOP_DEPTH_M + 15, TOP_DEPTH_M + 30])
    loss_db = np.empty((len(frequencies_khz), len(range_m), len(depth_m), len(depth_m)))
    for f, khz in enumerate(frequencies_khz):
        for a, auv_m in enumerate(depth_m):
            if bellhop:
                loss_db[f, :, a] = bellhop_db(bellhop, khz, range_m, auv_m, depth_m)
                continue
            for n, node_m in enumerate(depth_m):
                loss_db[f, :, a, n] = images_db(khz, range_m, auv_m, node_m)
    np.savez(
        out,
        frequency_khz=frequencies_khz,
        range_m=range_m,
        auv_depth_m=depth_m,
        node_depth_m=depth_m,
        loss_db=loss_db,
    )
    for metres in (20, 100, 500):
        i = np.abs(range_m - metres).argmin()
        print(
            f"{range_m[i]:.0f} m, {frequencies_khz[-1]:g} kHz, {depth_m[0]:g} to {depth_m[-1]:g} m "
            f"depth: {loss_db[-1, i, 0, -1]:.1f} dB"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("loss.npz"))
    parser.add_argument("--bellhop", help="Bellhop's executable; the method of images without it")
    given = parser.parse_args()
    formula = load_scenario("paper/k3-fdd", SEA)
    duplex = formula.duplex
    frequencies = sorted({duplex.charging_frequency_khz, duplex.uplink_frequency_khz})
    write_table(given.out, frequencies, given.bellhop)
    transmission = {"kind": "range_depth", "tables": [given.out], "top_depth_m": TOP_DEPTH_M}
    table = load_scenario(formula, {"channel.transmission": transmission})
    for name, scenario in (("formula", formula), ("table", table)):
        played = evaluate(scenario, "greedy", episodes=1).metrics
        print(
            f"{name}: mean AoI {played['mean_aoi'].mean:.2f} slots, "
            f"{played['harvested_kj'].mean * 1000:.1f} J harvested"
        )


if __name__ == "__main__":
    main()
