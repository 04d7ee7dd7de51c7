"""The paper's table of required energies, and the figures that pin down its channel."""

import csv
from pathlib import Path

import pytest

from iout_marl import paper
from iout_marl.physics import (
    approximate_required_energy_j,
    harvested_energy_j,
    harvested_power_w,
    kappa,
    kappa_2,
    kappa_3,
    received_level_db,
    required_energy_j,
    required_snr,
    source_level_db,
    table_attenuation_db,
    thorp_absorption_db_per_km,
    transmission_loss_db,
    transmit_power_w,
)

REFERENCE = Path(paper.__file__).parent / "data" / "energy_table.csv"
SLOT_S, PACKET_BITS, BANDWIDTH_HZ, NOISE_DB = 25, 100, 3000, 30
SOURCE_DB, SENSITIVITY_DB, LOAD_OHM = 220.8, -150, 125
CODE_HARVESTER = {"efficiency": 0.7, "hydrophones": 2}
PRINTED_HARVESTER = {"efficiency": 0.5, "hydrophones": 1}

with REFERENCE.open(newline="", encoding="utf-8") as file:
    ROWS = list(csv.DictReader(file))
CELLS = [
    pytest.param(float(row["distance_m"]), column, printed, id=f"{row['distance_m']} m {column}")
    for row in ROWS
    for column, printed in row.items()
    if column != "distance_m"
]


def attenuation_db(distance_m, frequency_khz=40, loss=table_attenuation_db):
    return loss(distance_m, thorp_absorption_db_per_km(frequency_khz), 1.5)


def uplink_energy_j(attenuation, uplink_s):
    snr = required_snr(PACKET_BITS, uplink_s, BANDWIDTH_HZ)
    return required_energy_j(transmit_power_w(snr, attenuation, NOISE_DB), uplink_s)


def slot_harvest_j(attenuation, harvester):
    level = received_level_db(SOURCE_DB, attenuation, NOISE_DB)
    power = harvested_power_w(level, SENSITIVITY_DB, LOAD_OHM, **harvester)
    return harvested_energy_j(power, SLOT_S)


@pytest.mark.parametrize(("distance_m", "column", "printed"), CELLS)
def test_required_energy_meets_every_printed_digit(distance_m, column, printed):
    attenuation = attenuation_db(distance_m)
    if column == "approximated_j":
        # The column was computed with the κ that the paper prints, not with the exact one.
        printed_kappa = round(kappa(PACKET_BITS, BANDWIDTH_HZ, NOISE_DB), 3)
        energy = approximate_required_energy_j(attenuation, printed_kappa)
    else:
        beta = float(column.removeprefix("true_j_beta_"))
        energy = uplink_energy_j(attenuation, (1 - beta) * SLOT_S)
    assert f"{energy:.4f}" == printed


def test_energy_table_has_six_distances_and_four_columns():
    assert len(CELLS) == 24


def test_kappa_of_the_paper():
    assert f"{kappa(PACKET_BITS, BANDWIDTH_HZ, NOISE_DB):.3f}" == "23.105"


def test_kappa_3_of_the_code_harvester():
    k2 = kappa_2(SOURCE_DB, NOISE_DB, SENSITIVITY_DB, LOAD_OHM, **CODE_HARVESTER)
    assert f"{kappa_3(k2, NOISE_DB):.7f}" == "0.0336634"


def test_source_level_of_the_paper():
    assert f"{source_level_db(2000, 0.5, 20):.1f}" == "220.8"


@pytest.mark.parametrize(
    ("harvester", "printed"), [(CODE_HARVESTER, "313.4"), (PRINTED_HARVESTER, "111.9")]
)
def test_energy_harvested_in_a_slot_at_100_m(harvester, printed):
    assert f"{slot_harvest_j(attenuation_db(100), harvester):.1f}" == printed


def test_printed_attenuation_equation_leaves_next_to_nothing_at_100_m():
    charging = attenuation_db(100, 40, transmission_loss_db)
    uplink = attenuation_db(100, 30, transmission_loss_db)
    assert f"{slot_harvest_j(charging, PRINTED_HARVESTER):.2f}" == "0.22"
    assert round(uplink_energy_j(uplink, SLOT_S), -3) == 28_000
