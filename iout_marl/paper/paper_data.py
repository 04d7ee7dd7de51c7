"""The paper's own numbers: claims, its table of energies, what its trainings took, its layout."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from iout_marl.core.grid import Grid
from iout_marl.scenario import load_scenario

_DATA = Path(__file__).parent / "data"


def _rows(name: str) -> list[dict[str, str]]:
    with (_DATA / name).open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@dataclass(frozen=True)
class Claim:
    """A claim of the paper.

    Attributes:
        key: its identifier.
        source: the figure, table or problem that it is made of.
        text: the claim.
        value: its figures; may be empty.
    """

    key: str
    source: str
    text: str
    value: str


def claims() -> list[Claim]:
    """All claims, in the paper's order."""
    return [
        Claim(row["id"], row["figure_or_table"], row["claim"], row["value"])
        for row in _rows("claims.csv")
    ]


@dataclass(frozen=True)
class PrintedEnergies:
    """A row of the appendix's table of required energies, as printed.

    Attributes:
        distance_m: d.
        approximated_j: by κ·10^(AL/10).
        true_j: the printed energy for each β.
    """

    distance_m: float
    approximated_j: str
    true_j: dict[float, str]


def printed_energies() -> list[PrintedEnergies]:
    """The appendix's table."""
    prefix = "true_j_beta_"
    return [
        PrintedEnergies(
            float(row["distance_m"]),
            row["approximated_j"],
            {float(k.removeprefix(prefix)): v for k, v in row.items() if k.startswith(prefix)},
        )
        for row in _rows("energy_table.csv")
    ]


@dataclass(frozen=True)
class PrintedCost:
    """What a training of the paper took."""

    minutes: float
    energy_kwh: float
    co2_kg: float


def printed_costs() -> dict[tuple[int, str], PrintedCost]:
    """By number of nodes and duplex mode (`tdd`, `fdd`)."""
    return {
        (int(row["nodes"]), row["duplex"].lower()): PrintedCost(
            float(row["train_minutes"]), float(row["energy_kwh"]), float(row["co2_kg"])
        )
        for row in _rows("training_cost.csv")
    }


def mean_distance_from_start(nodes: float) -> str | None:
    """Figures of the first nodes of the paper's layout from the AUV's start; None of no number."""
    scenario = load_scenario("paper/k10-tdd")
    cells = np.array(scenario.nodes.cells)
    if nodes not in range(1, len(cells) + 1):
        return None
    offset = cells[: int(nodes)] - np.array(scenario.auvs.start_cells[0])
    return f"{Grid.from_scenario(scenario).metres(offset).mean():.0f} m"
