"""The oracle against printed numbers, so that it and the world cannot be wrong alike."""

import csv
from pathlib import Path

import pytest
from oracle import Oracle, Sound, ambient_noise_db, francois_garrison, thorp

from iout_marl import paper
from iout_marl.scenario import load_scenario

REFERENCE = Path(__file__).parents[1] / "reference"
WATER = {  # temperature in °C, salinity in psu, depth in m, pH
    "Francois-Garrison 27C S35 10m pH8.1": (27, 35, 10, 8.1),
    "Francois-Garrison 10C S35 200m pH8.0": (10, 35, 200, 8.0),
    "Francois-Garrison 4C S35 1000m pH8.0": (4, 35, 1000, 8.0),
}
WIND_M_PER_S = {f"Wenz-Coates shipping .5 wind {wind} m/s": wind for wind in (0, 5, 10)}


PRINTED = Path(paper.__file__).parent / "data" / "energy_table.csv"


def rows(path):
    with path.open(newline="", encoding="utf-8") as lines:
        return list(csv.DictReader(lines))


@pytest.mark.parametrize("row", rows(PRINTED), ids=lambda row: row["distance_m"])
@pytest.mark.parametrize("beta", ["0.1", "0.5", "0.9"])
def test_required_energy_is_that_of_the_papers_table(row, beta):
    sound = Sound(load_scenario("paper/k3-tdd"))
    required_j = sound.required_j(float(row["distance_m"]), (1 - float(beta)) * 25)
    assert f"{required_j:.4f}" == row[f"true_j_beta_{beta}"]


def test_harvested_energy_at_100_m_is_that_of_the_papers_results():
    assert Sound(load_scenario("paper/k3-tdd")).harvested_j(100, 25) == pytest.approx(
        313.4, abs=0.05
    )


@pytest.mark.parametrize(("beta", "distance_m"), [(0.1, 37), (0.9, 298)])
def test_harvest_meets_need_at_the_distance_of_the_papers_figure(beta, distance_m):
    sound = Sound(load_scenario("paper/k3-tdd"))

    def surplus_j(d):
        return sound.harvested_j(d, beta * 25) - sound.required_j(d, (1 - beta) * 25)

    assert surplus_j(distance_m - 1) > 0 > surplus_j(distance_m + 1)


def test_printed_attenuation_leaves_next_to_nothing_and_asks_28000_j_at_100_m():
    sound = Sound(load_scenario("paper/k3-fdd", {"channel.kind": "equation"}))
    printed_harvester = 0.5 / (2 * 0.7)
    assert sound.harvested_j(100, 25) * printed_harvester == pytest.approx(0.22, abs=0.005)
    assert sound.required_j(100, 25) == pytest.approx(28000, rel=0.01)


@pytest.mark.parametrize(
    "row",
    [
        row
        for row in rows(REFERENCE / "acoustics.csv")
        if row["quantity"] in ("absorption", "noise")
    ],
    ids=lambda row: f"{row['conditions']} {row['frequency_khz']} kHz",
)
def test_absorption_and_noise_are_the_reference_values(row):
    f, conditions = float(row["frequency_khz"]), row["conditions"]
    if row["quantity"] == "noise":
        value = ambient_noise_db(f, 0.5, WIND_M_PER_S[conditions])
    else:
        value = thorp(f) if conditions == "Thorp" else francois_garrison(f, *WATER[conditions])
    places = len(row["value"].partition(".")[2])
    assert value == pytest.approx(float(row["value"]), abs=0.6 * 10**-places)


def test_node_charged_in_a_slot_transmits_in_it():
    oracle = Oracle(
        load_scenario("paper/k3-fdd", {"auvs.start_cells": [[1, 2, 1]]}), [(1, 1, 1)] * 3
    )
    oracle.step([(3, 0, 0)])
    assert (oracle.age, oracle.deliveries) == ([1, 2, 2], [1, 0, 0])
