"""Properties of sea water against published formulas, and the laws they must follow."""

import csv
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from iout_marl.physics import (
    ambient_noise_band_level_db,
    ambient_noise_spectral_level_db,
    francois_garrison_absorption_db_per_km,
    mackenzie_sound_speed_m_per_s,
    thorp_absorption_db_per_km,
)

REFERENCE = Path(__file__).parents[1] / "reference" / "acoustics.csv"
MODELS = {
    "Thorp": thorp_absorption_db_per_km,
    "Francois-Garrison": francois_garrison_absorption_db_per_km,
    "Wenz-Coates": ambient_noise_spectral_level_db,
    "Mackenzie": mackenzie_sound_speed_m_per_s,
}
with REFERENCE.open(newline="", encoding="utf-8") as file:
    ROWS = list(csv.DictReader(file))

law = settings(max_examples=50, deadline=None)
frequencies_khz = st.floats(0.2, 500)
shippings = st.floats(0, 1)
winds_m_per_s = st.floats(0, 20)


@pytest.mark.parametrize("row", ROWS, ids=lambda r: f"{r['frequency_khz']} kHz {r['conditions']}")
def test_reference_value_is_met_to_its_printed_digits(row):
    model, *conditions = row["conditions"].split(" ")
    numbers = re.findall(r"\d*\.?\d+", " ".join(conditions))
    frequency = [row["frequency_khz"]] if row["frequency_khz"] else []
    value = MODELS[model](*map(float, frequency + numbers))
    decimals = len(row["value"].partition(".")[2])
    assert f"{value:.{decimals}f}" == row["value"]


@pytest.mark.parametrize(
    ("frequency_khz", "temperature_c", "salinity_psu", "depth_m", "ph", "expected"),
    [
        (1, 15, 30, 500, 7.9, 0.0475080),
        (200, 15, 30, 500, 7.9, 54.5653),
        (1, 4, 38, 2000, 8.2, 0.0819513),
    ],
)
def test_francois_garrison_in_water_of_other_salinity_agrees_with_arlpy(
    frequency_khz, temperature_c, salinity_psu, depth_m, ph, expected
):
    absorption = francois_garrison_absorption_db_per_km(
        frequency_khz, temperature_c, salinity_psu, depth_m, ph
    )
    assert absorption == pytest.approx(expected, rel=2e-6)


@pytest.mark.parametrize(
    ("frequency_khz", "temperature_c", "salinity_psu", "depth_m", "ph", "expected"),
    [
        (5, 4, 30, 3000, 7.7, 0.19575189288379335),
        (40, 10, 35, 100, 8.0, 10.870712202885485),
        (100, 27, 38, 1000, 8.2, 33.438601766546796),
        (400, 0, 33, 10, 8.1, 99.33210480095414),
    ],
)
def test_francois_garrison_is_that_of_arlpy_to_all_digits(
    frequency_khz, temperature_c, salinity_psu, depth_m, ph, expected
):
    # At 20 °C exactly arlpy takes the other of the two fits of the water term: 2e-4 apart.
    found = francois_garrison_absorption_db_per_km(
        frequency_khz, temperature_c, salinity_psu, depth_m, ph
    )
    assert found == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("temperature_c", "salinity_psu", "depth_m", "expected"),
    [
        (5, 33, 4000, 1535.6927269999999),
        (27, 35, 10, 1539.0866009307247),
        (2, 30, 100, 1452.9659127722),
        (15, 38, 2000, 1543.435307),
    ],
)
def test_sound_speed_is_that_of_arlpy_to_all_digits(temperature_c, salinity_psu, depth_m, expected):
    speed = mackenzie_sound_speed_m_per_s(temperature_c, salinity_psu, depth_m)
    assert speed == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize(
    ("temperature_c", "salinity_psu", "depth_m", "printed"),
    [(25, 35, 1000, "1550.744"), (40, 40, 10_000, "1718.774"), (5, 33, 4000, "1535.693")],
)
def test_sound_speed_meets_published_check_values(temperature_c, salinity_psu, depth_m, printed):
    speed = mackenzie_sound_speed_m_per_s(temperature_c, salinity_psu, depth_m)
    assert f"{speed:.3f}" == printed


@pytest.mark.parametrize(
    ("one", "other", "change_db"),
    [
        pytest.param((0.0001,), (0.001,), -30, id="turbulence falls by 30 dB a decade"),
        pytest.param((0.1, 0.5), (0.1, 1), 10, id="shipping adds 20 dB"),
        pytest.param((5, 0.5, 4), (5, 0.5, 9), 7.5, id="wind adds 7.5 dB per root of m/s"),
        pytest.param((300,), (600,), 20 * np.log10(2), id="heat rises by 20 dB a decade"),
    ],
)
def test_each_source_of_noise_rules_its_own_band(one, other, change_db):
    change = ambient_noise_spectral_level_db(*other) - ambient_noise_spectral_level_db(*one)
    assert change == pytest.approx(change_db, abs=0.06)


@pytest.mark.parametrize(
    ("frequency_khz", "shipping", "wind_m_per_s", "expected"),
    [
        (0.01, 0, 1, 77.1316395704901),
        (0.3, 1, 0, 65.3445136903894),
        (1, 0.5, 10, 67.8779294430473),
        (10, 0, 1, 36.8219208127681),
        (25, 0.5, 5, 38.5480775827335),
        (40, 0.3, 8, 39.026737754498),
        (100, 1, 15, 39.1484211978466),
        (500, 0, 0, 38.979619117585),
    ],
)
def test_noise_is_that_of_ns_3s_default_model(frequency_khz, shipping, wind_m_per_s, expected):
    """What its UanNoiseModelDefault::GetNoiseDbHz gives, compiled; arlpy has no model of noise."""
    found = ambient_noise_spectral_level_db(frequency_khz, shipping, wind_m_per_s)
    assert found == pytest.approx(expected, rel=1e-14)


def test_turbulence_alone_is_heard_at_one_hertz():
    assert ambient_noise_spectral_level_db(0.001) == pytest.approx(107, abs=0.001)


def test_reference_values_exercise_every_model():
    assert {row["conditions"].split(" ")[0] for row in ROWS} == set(MODELS)


@pytest.mark.parametrize(
    "absorption_db_per_km", [thorp_absorption_db_per_km, francois_garrison_absorption_db_per_km]
)
@law
@given(frequency_khz=frequencies_khz, ratio=st.floats(1.001, 3))
def test_absorption_rises_with_frequency(absorption_db_per_km, frequency_khz, ratio):
    low, high = absorption_db_per_km(np.array([frequency_khz, ratio * frequency_khz]))
    assert 0 < low < high


@pytest.mark.parametrize("frequency_khz", [1, 40, 500])
def test_francois_garrison_is_continuous_where_its_water_term_changes(frequency_khz):
    below, above = francois_garrison_absorption_db_per_km(frequency_khz, np.array([20, 20.001]))
    assert above == pytest.approx(below, rel=1e-3)


@law
@given(
    frequency_khz=st.floats(0.2, 100),
    shipping=st.floats(0, 0.9),
    wind_m_per_s=winds_m_per_s,
)
def test_noise_rises_with_shipping_and_wind(frequency_khz, shipping, wind_m_per_s):
    calm = ambient_noise_spectral_level_db(frequency_khz, shipping, wind_m_per_s)
    assert ambient_noise_spectral_level_db(frequency_khz, shipping + 0.1, wind_m_per_s) > calm
    assert ambient_noise_spectral_level_db(frequency_khz, shipping, wind_m_per_s + 0.1) > calm


@law
@given(
    frequency_khz=st.floats(1, 100),
    bandwidth_hz=st.floats(0.1, 10),
    shipping=shippings,
    wind_m_per_s=winds_m_per_s,
)
def test_narrow_band_holds_spectral_level_times_bandwidth(
    frequency_khz, bandwidth_hz, shipping, wind_m_per_s
):
    band = ambient_noise_band_level_db(frequency_khz, bandwidth_hz, shipping, wind_m_per_s)
    spectral = ambient_noise_spectral_level_db(frequency_khz, shipping, wind_m_per_s)
    assert band == pytest.approx(spectral + 10 * np.log10(bandwidth_hz), abs=1e-3)


@pytest.mark.parametrize(
    ("frequency_khz", "bandwidth_hz"),
    [(40, 3_000), (40, 70_000), (10, 15_000), (10, 19_900), (1, 1_900)],
)
@pytest.mark.parametrize(("shipping", "wind_m_per_s"), [(0.5, 0), (1, 10)])
def test_wide_band_equals_sum_over_thin_slices(frequency_khz, bandwidth_hz, shipping, wind_m_per_s):
    slices = 200_000
    centres = (np.arange(slices) + 0.5) / slices - 0.5
    density = 10 ** (
        ambient_noise_spectral_level_db(
            frequency_khz + centres * bandwidth_hz / 1e3, shipping, wind_m_per_s
        )
        / 10
    )
    expected = 10 * np.log10(density.sum() * bandwidth_hz / slices)
    band = ambient_noise_band_level_db(frequency_khz, bandwidth_hz, shipping, wind_m_per_s)
    assert band == pytest.approx(expected, abs=1e-5)


@law
@given(temperature_c=st.floats(-2, 30), salinity_psu=st.floats(25, 40), depth_m=st.floats(0, 7000))
def test_sound_is_faster_in_warmer_saltier_and_deeper_water(temperature_c, salinity_psu, depth_m):
    steps = np.array([[0, 0, 0], [0.5, 0, 0], [0, 0.5, 0], [0, 0, 50]])
    speed = mackenzie_sound_speed_m_per_s(
        *(np.array([temperature_c, salinity_psu, depth_m]) + steps).T
    )
    assert np.all(speed[1:] > speed[0])
