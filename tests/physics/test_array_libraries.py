"""Every public function answers alike, and in kind, whatever library its arrays are of."""

import array_api_compat
import array_api_strict
import numpy as np
import pytest
import torch

from iout_marl import physics

LIBRARIES = {
    "numpy": array_api_compat.array_namespace(np.empty(0)),
    "torch": array_api_compat.array_namespace(torch.empty(0)),
    "array_api_strict": array_api_strict,
}
FREQUENCIES = [0.5, 10, 40]
LEVELS = [120, 160, 180]
LOSSES = [3.5, 30, 60]
SNRS = [1e-3, 0.1, 2]
EFFICIENCIES = [0.3, 0.5, 0.7]
NOISES = [20, 30, 45]
BETAS = [0.1, 0.5, 0.9]
SLOT = (25, 100, 3000)

#: The array arguments of every public function, then its plain numbers.
#: Areas, drag coefficients, efficiencies.
HULL = [[0.5, 3, 10], [0.003, 0.006, 0.1], [0.3, 0.7, 1]]
CASES = {
    "airtime_s": ([[100, 2048, 30_000], [80, 1000, 5000]], ()),
    "ambient_noise_band_level_db": (
        [FREQUENCIES, [100, 300, 900], [0, 0.5, 1], [0, 5, 10]],
        (),
    ),
    "ambient_noise_spectral_level_db": ([FREQUENCIES, [0, 0.5, 1], [0, 5, 10]], ()),
    "aperture_power_w": (
        [[170, 180, 220], [0.01, 0.02, 0.5], [2, 30, 1000], EFFICIENCIES, [0, 0.01, 0.1]],
        (),
    ),
    "approximate_required_energy_j": ([LOSSES, [10, 23, 40]], ()),
    "attenuation_at_balance_db": ([[1.5, 3, 4.5], [0.01, 0.03, 0.1]], ()),
    "attenuation_distance_m": ([[-1, 3, 20]], (12.9, 1.5)),
    "available_power_w": ([[0.1, 1, 20], [50, 125, 300]], ()),
    "beta_star": ([[400, 12, 3, 0.01], [1600, 2700, 2900, 3100]], SLOT),
    "electrical_power_w": ([LEVELS, EFFICIENCIES, [0, 10, 20]], ()),
    "francois_garrison_absorption_db_per_km": (
        [FREQUENCIES, [4, 20, 27], [33, 35, 36], [0, 100, 1000], [7.9, 8, 8.1]],
        (),
    ),
    "g": ([BETAS], SLOT),
    "g_slope": ([BETAS], SLOT),
    "h": ([LOSSES, [0.01, 0.03, 0.1]], ()),
    "harvested_energy_j": ([[0.1, 12, 300], [2.5, 12.5, 25]], ()),
    "harvested_power_w": (
        [LEVELS, [-160, -150, -140], [50, 125, 300], EFFICIENCIES, [1, 2, 4]],
        (),
    ),
    "incident_power_w": ([[170, 180, 220], [0.01, 0.02, 0.5], [2, 30, 1000]], ()),
    "induced_voltage_v": ([LEVELS, [-160, -150, -140]], ()),
    "intensity_w_per_m2": ([LEVELS], ()),
    "kappa": ([[10, 100, 800], [1000, 3000, 5000], NOISES], ()),
    "kappa_2": (
        [LEVELS, NOISES, [-160, -150, -140], [50, 125, 300], EFFICIENCIES, [1, 2, 4]],
        (),
    ),
    "economical_speed_m_per_s": ([[0, 40, 200], *HULL], ()),
    "kappa_3": ([[1, 34, 100], NOISES], ()),
    "mackenzie_sound_speed_m_per_s": ([[4, 10, 27], [33, 35, 36], [0, 100, 1000]], ()),
    "modem_energy_j": ([[0, 0.5, 20], [0.1, 1, 2], [100, 2048, 30_000], [80, 1000, 5000]], ()),
    "propulsion_power_w": ([[0, 1.5, 4], *HULL], ()),
    "received_level_db": ([LEVELS, LOSSES, NOISES], ()),
    "required_energy_j": ([[0.1, 12, 300], [2.5, 12.5, 25]], ()),
    "required_snr": ([[10, 100, 80_000], [2.5, 12.5, 25], [1000, 3000, 5000]], ()),
    "round_trip_s": ([[0, 100, 2000]], ()),
    "smallest_beta": (
        [[80, 0, 40, 20], [12, 12, 1, 0.01], [1600, 2700, 2900, 3100]],
        (*SLOT, 0.1, 0.9),
    ),
    "sonar_transmit_power_w": ([SNRS, LOSSES, NOISES, EFFICIENCIES, [0, 10, 20]], ()),
    "source_level_db": ([[0.1, 5, 2000], EFFICIENCIES, [0, 10, 20]], ()),
    "table_attenuation_db": ([[0, 100, 2000], [1, 8, 13], [1, 1.5, 2]], ()),
    "thorp_absorption_db_per_km": ([FREQUENCIES], ()),
    "transmission_loss_db": ([[0, 100, 2000], [1, 8, 13], [1, 1.5, 2]], ()),
    "transmit_power_w": ([SNRS, LOSSES, NOISES], ()),
}
ARGUMENTS = [
    pytest.param(name, index, id=f"{name}-{index}")
    for name, (values, _) in CASES.items()
    for index in range(len(values))
]

each_library = pytest.mark.parametrize("xp", LIBRARIES.values(), ids=LIBRARIES)
each_function = pytest.mark.parametrize("name", CASES)


def evaluate(name, arguments):
    return getattr(physics, name)(*arguments, *CASES[name][1])


def by_numpy(name):
    return evaluate(name, [np.array(values, float) for values in CASES[name][0]])


def numbers(array):
    return np.from_dlpack(array) if np.ndim(array) else np.asarray(array)


def test_every_public_function_has_a_case():
    assert set(CASES) == {name for name in physics.__all__ if not name.isupper()}


@each_library
@each_function
def test_libraries_agree(xp, name):
    arguments = [xp.asarray(values, dtype=xp.float64) for values in CASES[name][0]]
    result = evaluate(name, arguments)
    assert array_api_compat.array_namespace(result) is xp
    assert result.dtype == xp.float64
    np.testing.assert_allclose(numbers(result), by_numpy(name), rtol=1e-12, strict=True)


@each_library
@each_function
def test_single_precision_is_kept(xp, name):
    arguments = [xp.asarray(values, dtype=xp.float32) for values in CASES[name][0]]
    result = evaluate(name, arguments)
    assert result.dtype == xp.float32
    np.testing.assert_allclose(numbers(result), by_numpy(name), rtol=1e-3, atol=1e-6)


@pytest.mark.slow
@each_library
@pytest.mark.parametrize(("name", "index"), ARGUMENTS)
def test_one_array_among_numbers_decides_library_and_dtype(xp, name, index):
    values = CASES[name][0]
    arguments = [argument[1] for argument in values]
    arguments[index] = xp.asarray(values[index], dtype=xp.float32)
    result = evaluate(name, arguments)
    assert array_api_compat.array_namespace(result) is xp
    assert result.dtype == xp.float32
    assert result.shape == (len(values[index]),)


@pytest.mark.slow
@each_library
@each_function
def test_arguments_broadcast(xp, name):
    first, *others = (xp.asarray(values, dtype=xp.float64) for values in CASES[name][0])
    rows = first.shape[0]
    result = evaluate(name, [xp.reshape(first, (rows, 1)), *others])
    columns = others[0].shape[0] if others else 1
    assert result.shape == (rows, columns)
    for row in range(rows):
        alone = evaluate(name, [first[row], *others])
        np.testing.assert_allclose(numbers(result)[row], numbers(alone), rtol=1e-12)


@each_function
def test_python_numbers_are_accepted(name):
    singles = [evaluate(name, arguments) for arguments in zip(*CASES[name][0], strict=True)]
    assert all(single.shape == () and single.dtype == np.float64 for single in singles)
    np.testing.assert_allclose(singles, by_numpy(name), rtol=1e-12)


@each_function
def test_result_stays_on_the_device_of_its_arrays(name):
    device = array_api_strict.Device("device1")
    arguments = [array_api_strict.asarray(v, device=device) for v in CASES[name][0]]
    assert evaluate(name, arguments).device == device


@each_library
def test_integer_arrays_are_read_as_floating(xp):
    frequency = xp.asarray([1, 10, 40])
    np.testing.assert_allclose(
        numbers(physics.thorp_absorption_db_per_km(frequency)),
        physics.thorp_absorption_db_per_km(np.array([1.0, 10, 40])),
        rtol=1e-12,
        strict=True,
    )


@each_library
def test_integer_array_takes_the_dtype_of_the_floating_one_beside_it(xp):
    absorption = xp.asarray([1, 8, 13], dtype=xp.float32)
    loss = physics.table_attenuation_db(xp.asarray([1, 100, 2000]), absorption)
    assert loss.dtype == xp.float32


@each_library
def test_what_was_computed_from_numbers_goes_with_every_library(xp):
    attenuation = xp.asarray(LOSSES, dtype=xp.float32)
    level = physics.received_level_db(physics.source_level_db(2000, 0.5, 20), attenuation)
    assert array_api_compat.array_namespace(level) is xp
    assert level.dtype == xp.float32


@each_library
def test_result_for_an_array_without_axes_has_none(xp):
    loss = physics.transmission_loss_db(xp.asarray(100, dtype=xp.float32), 12.9)
    assert loss.shape == ()
    assert loss.dtype == xp.float32
