"""Laws of the level at a receiver, of the energy in it and of the energy of an uplink."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from iout_marl.physics import (
    REFERENCE_LEVEL_DB,
    approximate_required_energy_j,
    available_power_w,
    electrical_power_w,
    harvested_energy_j,
    harvested_power_w,
    induced_voltage_v,
    kappa,
    received_level_db,
    required_energy_j,
    required_snr,
    sonar_transmit_power_w,
    source_level_db,
    table_attenuation_db,
    thorp_absorption_db_per_km,
    transmission_loss_db,
    transmit_power_w,
)

SLOT_S, BANDWIDTH_HZ, NOISE_DB = 25, 3000, 30
LOSSES = [table_attenuation_db, transmission_loss_db]

law = settings(max_examples=50, deadline=None)
distances_m = st.floats(1, 3000)
ratios = st.floats(1.001, 3)
frequencies_khz = st.floats(1, 100)
betas = st.floats(0.01, 0.95)
powers_w = st.floats(1e-6, 1e6)
efficiencies = st.floats(0.01, 1)
directivities_db = st.floats(-10, 40)


def harvest_j(distance_m, frequency_khz, loss, beta=0.5):
    attenuation = loss(distance_m, thorp_absorption_db_per_km(frequency_khz))
    power = harvested_power_w(received_level_db(220.8, attenuation), -150, 125, 0.7, 2)
    return harvested_energy_j(power, beta * SLOT_S)


def uplink_energy_j(beta, packet_bits, attenuation_db=30):
    uplink_s = (1 - beta) * SLOT_S
    snr = required_snr(packet_bits, uplink_s, BANDWIDTH_HZ)
    return required_energy_j(transmit_power_w(snr, attenuation_db, NOISE_DB), uplink_s)


@pytest.mark.parametrize("loss", LOSSES)
@law
@given(distance_m=distances_m, ratio=ratios, frequency_khz=frequencies_khz)
def test_harvested_energy_falls_with_distance(loss, distance_m, ratio, frequency_khz):
    near, far = harvest_j(np.array([distance_m, ratio * distance_m]), frequency_khz, loss)
    assert near > far > 0


@pytest.mark.parametrize("loss", LOSSES)
@law
@given(distance_m=distances_m, frequency_khz=frequencies_khz, beta=betas)
def test_harvested_energy_rises_with_beta(loss, distance_m, frequency_khz, beta):
    less, more = harvest_j(distance_m, frequency_khz, loss, np.array([beta, beta + 0.01]))
    assert more > less > 0


@law
@given(packet_bits=st.floats(10, 2e5), one=betas, other=betas)
def test_required_energy_is_convex_in_beta(packet_bits, one, other):
    low, middle, high = uplink_energy_j(np.array([one, (one + other) / 2, other]), packet_bits)
    assert middle <= (low + high) / 2 * (1 + 1e-12)


@law
@given(packet_bits=st.floats(10, 2e5), beta=st.floats(0.01, 0.9))
def test_required_energy_rises_with_beta(packet_bits, beta):
    less, more = uplink_energy_j(np.array([beta, beta + 0.05]), packet_bits)
    assert more > less


@law
@given(packet_bits=st.floats(10, 2e5), beta=betas, attenuation_db=st.floats(0, 100))
def test_approximate_energy_is_a_lower_bound_that_small_packets_reach(
    packet_bits, beta, attenuation_db
):
    approximate = approximate_required_energy_j(
        attenuation_db, kappa(packet_bits, BANDWIDTH_HZ, NOISE_DB)
    )
    true = uplink_energy_j(beta, packet_bits, attenuation_db)
    exponent = math.log(2) * packet_bits / ((1 - beta) * SLOT_S * BANDWIDTH_HZ)
    assert approximate < true <= approximate * math.exp(exponent)


@law
@given(
    packet_bits=st.floats(1, 1e5), duration_s=st.floats(0.1, 100), bandwidth_hz=st.floats(1e3, 1e5)
)
def test_required_snr_makes_the_channel_carry_the_packet(packet_bits, duration_s, bandwidth_hz):
    snr = required_snr(packet_bits, duration_s, bandwidth_hz)
    bits = duration_s * bandwidth_hz * np.log1p(snr) / math.log(2)
    assert bits == pytest.approx(packet_bits, rel=1e-12)


@law
@given(power_w=powers_w, efficiency=efficiencies, directivity_db=directivities_db)
def test_electrical_power_inverts_source_level(power_w, efficiency, directivity_db):
    level = source_level_db(power_w, efficiency, directivity_db)
    assert electrical_power_w(level, efficiency, directivity_db) == pytest.approx(
        power_w, rel=1e-12
    )


def test_one_acoustic_watt_gives_the_reference_level():
    assert source_level_db(1, 1) == REFERENCE_LEVEL_DB
    assert source_level_db(4, 0.25) == pytest.approx(REFERENCE_LEVEL_DB, rel=1e-12)


@law
@given(
    snr_db=st.floats(-40, 40),
    loss_db=st.floats(0, 120),
    noise_db=st.floats(0, 90),
    efficiency=efficiencies,
    directivity_db=directivities_db,
)
def test_sonar_transmit_power_arrives_with_the_snr_asked_for(
    snr_db, loss_db, noise_db, efficiency, directivity_db
):
    power = sonar_transmit_power_w(
        10 ** (snr_db / 10), loss_db, noise_db, efficiency, directivity_db
    )
    level = received_level_db(source_level_db(power, efficiency, directivity_db), loss_db)
    assert level - noise_db == pytest.approx(snr_db, abs=1e-9)


@pytest.mark.parametrize("loss", LOSSES)
def test_nothing_spreads_nearer_than_one_metre(loss):
    assert loss(np.array([0, 0.5, 1.0]), 10) == pytest.approx([0, 0.005, 0.01], rel=1e-12)


@law
@given(distance_m=distances_m, spreading_factor=st.floats(1, 2))
def test_printed_equation_spreads_ten_times_as_much_as_the_table(distance_m, spreading_factor):
    table = table_attenuation_db(distance_m, 0, spreading_factor)
    printed = transmission_loss_db(distance_m, 0, spreading_factor)
    assert printed == pytest.approx(10 * table, rel=1e-12)
    assert printed == pytest.approx(spreading_factor * 10 * math.log10(distance_m), rel=1e-12)


@law
@given(distance_m=distances_m, absorption_db_per_km=st.floats(0, 50))
def test_absorption_adds_its_decibels_over_each_kilometre(distance_m, absorption_db_per_km):
    spread = transmission_loss_db(distance_m, 0)
    loss = transmission_loss_db(distance_m, absorption_db_per_km)
    assert loss - spread == pytest.approx(absorption_db_per_km * distance_m / 1000, abs=1e-9)


def test_noise_and_attenuation_are_subtracted_from_the_source_level():
    assert received_level_db(200, 30, 20) == 150
    assert received_level_db(200, 30) == 170


def test_pressure_of_one_micropascal_induces_the_sensitivity_in_volts():
    assert induced_voltage_v(0, -150) == pytest.approx(10**-7.5, rel=1e-12)


def test_matched_load_takes_a_quarter_of_the_squared_voltage():
    assert available_power_w(10, 125) == pytest.approx(0.2, rel=1e-12)


@law
@given(level_db=st.floats(50, 220), efficiency=efficiencies, hydrophones=st.integers(1, 8))
def test_hydrophones_and_efficiency_scale_the_available_power(level_db, efficiency, hydrophones):
    available = available_power_w(induced_voltage_v(level_db, -150), 125)
    power = harvested_power_w(level_db, -150, 125, efficiency, hydrophones)
    assert power == pytest.approx(hydrophones * efficiency * available, rel=1e-12)
