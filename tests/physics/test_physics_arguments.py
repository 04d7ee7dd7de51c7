"""Every argument of every public function: in any form, and only within its domain.

Functions and arguments are read from `iout_marl.physics`: one that is added there is tested here,
as soon as the name of each of its arguments has values below.
"""

import inspect
import itertools
import math
import warnings

import array_api_strict
import numpy as np
import pytest
import torch

from iout_marl import physics
from iout_marl.errors import InputError

LEVEL = ([-30.0, 40.0, 120.0], [])
FRACTION = ([0.0, 0.5, 1.0], [-0.1, 1.1, -1e300])
EFFICIENCY = ([0.3, 0.5, 1.0], [0, -1, 1.01, 50])
POSITIVE = ([0.5, 25.0, 3000.0], [0, -1, -1e-300])
NOT_NEGATIVE = ([0.0, 12.0, 3000.0], [-1, -1e-300])
#: By name of an argument: three good values, and bad ones.
VALUES = {
    "absorption_db_per_km": NOT_NEGATIVE,
    "acoustic_power_w": NOT_NEGATIVE,
    "area_m2": POSITIVE,
    "attenuation_db": LEVEL,
    "bandwidth_hz": ([100.0, 300.0, 900.0], [0, -1]),
    "beta": ([0.1, 0.5, 0.9], [-0.1, 0, 1, 1.1]),
    "beta_max": ([0.6, 0.8, 0.9], [1, 1.1, -0.1, 0.01]),
    "beta_min": ([0.1, 0.2, 0.3], [-0.1, 1, 1.1]),
    "bit_rate_bps": POSITIVE,
    "charging_s": NOT_NEGATIVE,
    "density_kg_per_m3": POSITIVE,
    "depth_m": ([0.0, 100.0, 11_000.0], [-1, 11_001]),
    "directivity_index_db": LEVEL,
    "distance_m": NOT_NEGATIVE,
    "drag_area_m2": POSITIVE,
    "drag_coefficient": POSITIVE,
    "duration_s": POSITIVE,
    "efficiency": EFFICIENCY,
    "electrical_power_w": POSITIVE,
    "electronics_power_w": NOT_NEGATIVE,
    "frequency_khz": ([0.5, 10.0, 1000.0], [0, -1, 30_000]),
    "g_value": LEVEL,
    "harvested_power_w": NOT_NEGATIVE,
    "hotel_w": NOT_NEGATIVE,
    "hydrophones": ([1, 2, 40], [0, -1, 1.5]),
    "kappa": NOT_NEGATIVE,
    "kappa_2_w": NOT_NEGATIVE,
    "kappa_3": POSITIVE,
    "load_resistance_ohm": POSITIVE,
    "noise_band_level_db": LEVEL,
    "noise_level_db": LEVEL,
    "packet_bits": POSITIVE,
    "ph": ([6.0, 8.0, 9.0], [5.9, 9.1, -8]),
    "power_per_snr_w": NOT_NEGATIVE,
    "power_w": NOT_NEGATIVE,
    "received_level_db": LEVEL,
    "salinity_psu": ([25.0, 35.0, 50.0], [-1, 51]),
    "sensitivity_db": ([-190.0, -150.0, -120.0], []),
    "shipping": FRACTION,
    "slot_s": POSITIVE,
    "snr": NOT_NEGATIVE,
    "source_level_db": LEVEL,
    "speed_m_per_s": NOT_NEGATIVE,
    "spreading_db_per_decade": ([0.0, 15.0, 40.0], [-1, 41]),
    "spreading_factor": ([0.0, 1.5, 4.0], [-0.1, 4.1]),
    "stored_j": LEVEL,
    "temperature_c": ([-2.0, 10.0, 40.0], [-300, -2.1, 41]),
    "threshold_w": NOT_NEGATIVE,
    "transmission_loss_db": LEVEL,
    "transmit_power_w": NOT_NEGATIVE,
    "uplink_s": NOT_NEGATIVE,
    "voltage_v": NOT_NEGATIVE,
    "wind_m_per_s": ([0.0, 5.0, 20.0], [-1, 121]),
}
FUNCTIONS = [name for name in physics.__all__ if callable(getattr(physics, name))]
ARGUMENTS = [
    (name, argument)
    for name in FUNCTIONS
    for argument in inspect.signature(getattr(physics, name)).parameters
]
BAD = [(*each, value) for each in ARGUMENTS for value in VALUES[each[1]][1]]
#: Whatever the argument.
NO_NUMBERS = [
    None,
    "3",
    "",
    b"3",
    ["1", "2"],
    [1, [2]],
    [1, None],
    {"a": 1},
    {1.0},
    object(),
    1j,
    True,
    [True, False],
    [1, True],
    [[1.0, 2.0], (3, np.True_)],
    [np.ones(2), np.array([True, False])],
    np.ma.masked,
    np.ma.array([1.0, 2.0], mask=[False, True]),
    np.ma.array([1.0, 2.0]),
    [1.0, np.ma.array(2.0, mask=True)],
    10**400,
    10**5000,
    np.array([1j]),
    np.array(["1"]),
    torch.tensor([True]),
    np.datetime64("2026-01-01"),
]
NOT_FINITE = [math.nan, math.inf, -math.inf, np.float32("inf")]


def good(name, place=1):
    """Good arguments of a function, the n-th of each."""
    return {
        argument: VALUES[argument][0][place]
        for argument in inspect.signature(getattr(physics, name)).parameters
    }


def numbers(result):
    return result.numpy() if isinstance(result, torch.Tensor) else np.asarray(result)


def test_every_argument_has_values():
    assert {argument for _, argument in ARGUMENTS} == set(VALUES)


FORMS = {
    "list": list,
    "tuple": tuple,
    "nested list": lambda values: [[value] for value in values],
    "list of NumPy numbers": lambda values: [np.float64(value) for value in values],
    "NumPy": np.array,
    "torch": lambda values: torch.tensor(values, dtype=torch.float64),
    "array_api_strict": lambda values: array_api_strict.asarray(
        values, dtype=array_api_strict.float64
    ),
    "of Python's integers": lambda values: [int(v) if v == int(v) else v for v in values],
}


@pytest.mark.parametrize(("name", "argument"), ARGUMENTS)
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.slow
def test_an_argument_in_any_form_is_its_numbers_one_by_one(name, argument, form):
    function, others = getattr(physics, name), good(name)
    values = VALUES[argument][0]
    expected = [float(function(**others | {argument: value})) for value in values]
    result = numbers(function(**others | {argument: FORMS[form](values)}))
    assert result.size == 3
    np.testing.assert_allclose(result.ravel(), expected, rtol=1e-12)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_lists_tuples_numbers_and_arrays_mix(name):
    function, forms = getattr(physics, name), itertools.cycle([list, tuple])
    columns = {argument: VALUES[argument][0] for argument in good(name)}
    expected = [float(function(**good(name, place))) for place in range(3)]
    for library in (np.asarray, torch.asarray):
        mixed = {argument: next(forms)(values) for argument, values in columns.items()}
        first = next(iter(mixed))
        mixed[first] = library([float(v) for v in columns[first]])
        result = function(**mixed)
        assert isinstance(result, torch.Tensor) == (library is torch.asarray)
        np.testing.assert_allclose(numbers(result), expected, rtol=1e-4)


@pytest.mark.parametrize(("name", "argument", "value"), BAD)
@pytest.mark.parametrize("form", [lambda value: value, lambda value: [value], np.asarray])
@pytest.mark.slow
def test_what_lies_outside_a_domain_is_refused_by_name_and_value(name, argument, value, form):
    with pytest.raises(InputError) as refused:
        getattr(physics, name)(**good(name) | {argument: form(value)})
    message = str(refused.value)
    if argument == "beta_min" and value < 1 and value >= 0:
        argument = "beta_max"
    assert message.startswith(f"{argument} must ")
    assert message.endswith(f": it is {value:g}")


@pytest.mark.slow
@pytest.mark.parametrize(("name", "argument"), ARGUMENTS)
def test_what_is_no_number_is_refused_by_name(name, argument):
    for value in NO_NUMBERS:
        with pytest.raises(InputError, match=rf"^{argument} must be a number or an array of"):
            getattr(physics, name)(**good(name) | {argument: value})
    for value in [*NOT_FINITE, [VALUES[argument][0][1], math.nan]]:
        with pytest.raises(InputError, match=rf"^{argument} must be finite and "):
            getattr(physics, name)(**good(name) | {argument: value})


@pytest.mark.parametrize("asarray", [np.asarray, torch.asarray, array_api_strict.asarray])
def test_one_bad_element_is_enough_and_is_named(asarray):
    with pytest.raises(InputError, match=r"^distance_m must not be negative: it is -1$"):
        physics.table_attenuation_db(asarray([0.0, -1.0, 100.0]), 12.9)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_good_values_give_numbers_without_a_warning_up_to_the_edges(name):
    extreme = {
        argument: [*values[0], min(values[0]), max(values[0])]
        for argument, values in VALUES.items()
    }
    rng = np.random.default_rng(0)
    columns = {argument: rng.permutation(extreme[argument] * 20) for argument in good(name)}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = getattr(physics, name)(**columns)
    if name not in ("smallest_beta", "beta_star", "attenuation_distance_m"):  # NaN for none
        assert not np.isnan(result).any()


def test_numbers_beyond_every_type_are_infinite_without_a_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert physics.required_snr(1e9, 1, 1) == math.inf
        assert physics.electrical_power_w(1e9, 0.5) == math.inf
        assert physics.g(0.5, 1e-3, 1e9, 1) == -math.inf
        assert math.isfinite(physics.g_slope(0.5, 1e-3, 1e9, 1))


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("transmit_power_w", (0, 0, 1e4)),
        ("transmit_power_w", ([1, 0], 0, [[1.0], [1e4]])),
        ("sonar_transmit_power_w", (0, 0, 1e4, 0.001, 1)),
        ("approximate_required_energy_j", (1e4, 0)),
        ("g_slope", (1e-15, 1e15, 1e-15, 1e300)),
        ("kappa_3", (0, -1e4)),
        ("kappa", (1e-300, 1e300, 1e4)),
    ],
)
@pytest.mark.parametrize("library", [np.asarray, torch.asarray], ids=["NumPy", "torch"])
def test_numbers_of_which_nothing_comes_are_refused(name, arguments, library):
    given = [library(np.asarray(value, float)) for value in arguments]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(InputError) as refused:
            getattr(physics, name)(*given)
    names = inspect.signature(getattr(physics, name)).parameters
    extreme = [f"{n} {np.max(value):g}" for n, value in zip(names, arguments, strict=False)]
    message = str(refused.value)
    assert message.startswith(f"{name}: too large or too small to compute with: ")
    assert extreme[-1] in message


@pytest.mark.slow
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("name", FUNCTIONS)
def test_gradients_go_through_without_a_warning(name, dtype):
    given = {
        argument: torch.tensor(value, dtype=dtype, requires_grad=True)
        for argument, value in good(name).items()
    }
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = getattr(physics, name)(**given)
        result.backward()
    assert result.dtype == dtype
    assert any(argument.grad is not None for argument in given.values())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for argument in given:
            wrong = torch.tensor(math.nan, dtype=dtype, requires_grad=True)
            with pytest.raises(InputError, match=f"^{argument} must be finite"):
                getattr(physics, name)(**given | {argument: wrong})


def test_gradient_of_a_number_of_another_type_goes_through():
    duration_s = torch.tensor(100.0, dtype=torch.float64, requires_grad=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        physics.required_energy_j(torch.tensor(5.0), duration_s).backward()
    assert duration_s.grad == 5


def test_arrays_of_two_libraries_are_refused_by_name():
    with pytest.raises(InputError, match=r"^distance_m, spreading_factor must be arrays of one"):
        physics.transmission_loss_db(np.ones(2), 1.0, torch.ones(2))


def test_a_band_must_stay_above_0_hz():
    assert math.isfinite(physics.ambient_noise_band_level_db(40, 79_999))
    with pytest.raises(InputError, match=r"^bandwidth_hz must be above 0 and keep the band"):
        physics.ambient_noise_band_level_db([40, 30], 70_000)


# array_api_compat caches which library an array is of; the compiler looks through that.
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Dynamo detected a call to a `functools.lru_cache`")
def test_unchecked_formulas_compile_into_one_graph():
    snr = torch.compile(physics.required_snr.unchecked, fullgraph=True, backend="eager")
    expected = physics.required_snr(100, torch.tensor([1.0, 2.0]), 3000)
    assert torch.equal(snr(100, torch.tensor([1.0, 2.0]), 3000), expected)


# Where a search could give back the end of its interval ----------------------------------


@pytest.mark.parametrize(
    ("attenuation_db", "absorption", "spreading", "distance_m"),
    [
        (150, 0, 15, 1e10),
        (4000, 0, 40, 1e100),
        (1e5, 0, 1.5, math.inf),  # farther than numbers go
        (1, 0, 0, math.inf),  # no loss anywhere
        (5e9, 5, 0, 1e12),
        (0, 0, 15, 1),
        (0.005, 5, 15, 1),
        (-1, 5, 15, math.nan),
        (0.001, 5, 15, math.nan),  # nearer than 1 m
    ],
)
def test_distance_of_a_loss_is_the_true_one(attenuation_db, absorption, spreading, distance_m):
    found = physics.attenuation_distance_m(attenuation_db, absorption, spreading)
    assert found == pytest.approx(distance_m, rel=1e-11, nan_ok=True)


def test_distance_of_a_loss_has_that_loss():
    rng = np.random.default_rng(1)
    absorption, spreading = 10 ** rng.uniform(-9, 6, 2000), rng.uniform(0, 40, 2000)
    loss_db = absorption / 1000 + 10 ** rng.uniform(-3, 6, 2000)
    distance_m = physics.attenuation_distance_m(loss_db, absorption, spreading)
    again_db = spreading * np.log10(distance_m) + absorption * distance_m / 1000
    assert (distance_m >= 1).all()
    finite = np.isfinite(distance_m)
    assert finite.mean() > 0.99
    np.testing.assert_allclose(again_db[finite], loss_db[finite], rtol=1e-9, atol=1e-9)


def test_no_root_is_given_for_the_end_of_the_interval():
    slot = (25, 100, 3000)
    assert np.isnan(physics.smallest_beta(0, 1e-9, 1e9, *slot, 0.1, 0.9))
    assert np.isnan(physics.beta_star(1e-9, 1e9, *slot))  # too far
    assert np.isnan(physics.beta_star(1e9, 1e-9, *slot))  # too near
    # A packet so large that no number holds what it takes.
    assert np.isnan(physics.smallest_beta(1e300, 1e300, 1.0, 1, 1e6, 1, 0.1, 0.9))
