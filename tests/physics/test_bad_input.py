"""What is physically impossible is refused by name; what is merely extreme is not."""

import array_api_strict
import numpy as np
import pytest
import torch

from iout_marl import physics

#: Good arguments of a function, and the bad values of each argument that it checks.
CHECKED = {
    "thorp_absorption_db_per_km": ({"frequency_khz": 40}, {"frequency_khz": [0, -1]}),
    "francois_garrison_absorption_db_per_km": (
        {"frequency_khz": 40},
        {"frequency_khz": [0, -1], "salinity_psu": [0, -1], "depth_m": [-1]},
    ),
    "available_power_w": (
        {"voltage_v": 1, "load_resistance_ohm": 125},
        {"load_resistance_ohm": [0, -1]},
    ),
    "harvested_power_w": (
        {
            "received_level_db": 160,
            "sensitivity_db": -150,
            "load_resistance_ohm": 125,
            "efficiency": 0.7,
        },
        {"load_resistance_ohm": [0, -1]},
    ),
    "ambient_noise_spectral_level_db": (
        {"frequency_khz": 40},
        {"frequency_khz": [0, -1], "shipping": [-0.1, 1.1], "wind_m_per_s": [-1]},
    ),
    "ambient_noise_band_level_db": (
        {"frequency_khz": 40, "bandwidth_hz": 3000},
        {"bandwidth_hz": [-1, 0, 80_000], "shipping": [-0.1, 1.1], "wind_m_per_s": [-1]},
    ),
    "table_attenuation_db": (
        {"distance_m": 100, "absorption_db_per_km": 12.9},
        {"distance_m": [-1]},
    ),
    "transmission_loss_db": (
        {"distance_m": 100, "absorption_db_per_km": 12.9},
        {"distance_m": [-1]},
    ),
    "source_level_db": (
        {"electrical_power_w": 2000, "efficiency": 0.5},
        {"electrical_power_w": [0, -1], "efficiency": [0, -1]},
    ),
    "electrical_power_w": (
        {"source_level_db": 220, "efficiency": 0.5},
        {"efficiency": [0, -1]},
    ),
    "sonar_transmit_power_w": (
        {"snr": 1, "transmission_loss_db": 40, "noise_band_level_db": 50, "efficiency": 0.5},
        {"efficiency": [0, -1]},
    ),
    "mackenzie_sound_speed_m_per_s": (
        {"temperature_c": 10, "salinity_psu": 35, "depth_m": 100},
        {"depth_m": [-1]},
    ),
    "g": (
        {"beta": 0.5, "slot_s": 25, "packet_bits": 100, "bandwidth_hz": 3000},
        {"beta": [-0.1, 0, 1, 1.1]},
    ),
    "g_slope": (
        {"beta": 0.5, "slot_s": 25, "packet_bits": 100, "bandwidth_hz": 3000},
        {"beta": [-0.1, 0, 1, 1.1]},
    ),
}
BAD = [
    pytest.param(name, argument, value, id=f"{name}-{argument}={value}")
    for name, (_, bad) in CHECKED.items()
    for argument, values in bad.items()
    for value in [*values, float("nan")]
]


@pytest.mark.parametrize(("name", "argument", "value"), BAD)
def test_bad_value_is_refused_by_name(name, argument, value):
    good = CHECKED[name][0]
    with pytest.raises(ValueError, match=rf"^{argument} must "):
        getattr(physics, name)(**good | {argument: value})


@pytest.mark.parametrize("name", CHECKED)
def test_good_values_are_accepted(name):
    assert np.isfinite(getattr(physics, name)(**CHECKED[name][0]))


@pytest.mark.parametrize("asarray", [np.asarray, torch.asarray, array_api_strict.asarray])
def test_one_bad_element_is_enough(asarray):
    with pytest.raises(ValueError, match=r"^distance_m must not be negative"):
        physics.table_attenuation_db(asarray([0.0, -1.0, 100.0]), 12.9)


@pytest.mark.parametrize(
    ("name", "edge"),
    [
        ("table_attenuation_db", {"distance_m": 0}),
        ("transmission_loss_db", {"distance_m": 0}),
        ("mackenzie_sound_speed_m_per_s", {"depth_m": 0}),
        ("francois_garrison_absorption_db_per_km", {"depth_m": 0}),
        ("ambient_noise_spectral_level_db", {"shipping": 0, "wind_m_per_s": 0}),
        ("ambient_noise_spectral_level_db", {"shipping": 1}),
        ("ambient_noise_band_level_db", {"bandwidth_hz": 79_999}),
    ],
)
def test_edge_of_a_range_belongs_to_it(name, edge):
    assert np.isfinite(getattr(physics, name)(**CHECKED[name][0] | edge))
