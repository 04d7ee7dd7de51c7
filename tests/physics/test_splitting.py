"""How much of a slot goes to charging: the paper's figures and the laws of the root."""

import math

import array_api_strict
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from iout_marl.physics import (
    attenuation_at_balance_db,
    attenuation_distance_m,
    beta_star,
    g,
    g_slope,
    h,
    harvested_power_w,
    kappa_2,
    kappa_3,
    received_level_db,
    smallest_beta,
    table_attenuation_db,
    thorp_absorption_db_per_km,
    transmission_loss_db,
    transmit_power_w,
)

SLOT_S, PACKET_BITS, BANDWIDTH_HZ, NOISE_DB = 25, 100, 3000, 30
BETA_MIN, BETA_MAX = 0.1, 0.9
SLOT = (SLOT_S, PACKET_BITS, BANDWIDTH_HZ)
KAPPA_2 = kappa_2(220.8, NOISE_DB, -150, 125, 0.7, 2)
KAPPA_3 = kappa_3(KAPPA_2, NOISE_DB)
#: Whole metres at which β* is 0.1 and 0.9, by frequency in kHz.
FIGURE = {10: (66, 2161), 20: (54, 781), 30: (43, 435), 40: (37, 298), 50: (32, 230), 60: (29, 191)}

law = settings(max_examples=100, deadline=None)
frequencies_khz = st.floats(5, 100)
betas = st.floats(0.01, 0.95)
bits = st.floats(10, 2e5)
grid = np.linspace(BETA_MIN, BETA_MAX, 4001)


def attenuation_db(distance_m, frequency_khz=40):
    return table_attenuation_db(distance_m, thorp_absorption_db_per_km(frequency_khz))


def harvested_w(attenuation):
    level = received_level_db(220.8, attenuation, NOISE_DB)
    return harvested_power_w(level, -150, 125, 0.7, 2)


def star(distance_m, frequency_khz=40, **bounds):
    attenuation = attenuation_db(distance_m, frequency_khz)
    cost = transmit_power_w(1, attenuation, NOISE_DB)
    return beta_star(harvested_w(attenuation), cost, *SLOT, **bounds)


def balance_distance_m(beta, frequency_khz):
    attenuation = attenuation_at_balance_db(g(beta, *SLOT), KAPPA_3)
    return attenuation_distance_m(attenuation, thorp_absorption_db_per_km(frequency_khz), 1.5)


def required_j(beta, packet_bits):
    """Energy of the uplink at 1 W per unit of SNR."""
    uplink_s = (1 - beta) * SLOT_S
    return uplink_s * np.expm1(math.log(2) * packet_bits / (uplink_s * BANDWIDTH_HZ))


def required_slope_w(beta, packet_bits):
    """Growth of the required energy with the time spent charging."""
    exponent = math.log(2) * packet_bits / ((1 - beta) * SLOT_S * BANDWIDTH_HZ)
    return exponent * math.exp(exponent) - math.expm1(exponent)


def relative_balance(beta, stored_j, power_w, packet_bits):
    required = required_j(beta, packet_bits)
    return (stored_j + beta * SLOT_S * power_w - required) / required


def assert_smallest_beta_that_pays(stored_j, power_w, packet_bits):
    problem = (stored_j, power_w, packet_bits)
    beta = smallest_beta(
        stored_j, power_w, 1, SLOT_S, packet_bits, BANDWIDTH_HZ, BETA_MIN, BETA_MAX
    )
    on_grid = relative_balance(grid, *problem)
    if math.isnan(beta):
        assert np.all(on_grid < 1e-12)
        return
    assert BETA_MIN <= beta <= BETA_MAX
    if beta == BETA_MIN:
        assert relative_balance(beta, *problem) >= -1e-9
    else:
        assert relative_balance(beta, *problem) == pytest.approx(0, abs=1e-9)
    assert np.all(on_grid[grid < beta] < 1e-12)


@pytest.mark.parametrize("frequency_khz", FIGURE)
def test_distances_of_the_interval_ends_match_the_figure(frequency_khz):
    distances = balance_distance_m(np.array([BETA_MIN, BETA_MAX]), frequency_khz)
    assert np.all(np.abs(distances - FIGURE[frequency_khz]) < 1)


@pytest.mark.parametrize("beta", [0.1, 0.3, 0.5, 0.7, 0.9])
@pytest.mark.parametrize("frequency_khz", FIGURE)
def test_beta_star_agrees_with_the_closed_form_distance(frequency_khz, beta):
    distance = balance_distance_m(beta, frequency_khz)
    computed = star(distance, frequency_khz, beta_min=0.05, beta_max=0.95)
    assert computed == pytest.approx(beta, rel=1e-9)


@pytest.mark.parametrize("frequency_khz", FIGURE)
def test_beta_star_exists_only_between_the_two_distances(frequency_khz):
    near, far = balance_distance_m(np.array([BETA_MIN, BETA_MAX]), frequency_khz)
    distances = np.array([near * 0.999, near * 1.001, far * 0.999, far * 1.001])
    assert np.isnan(star(distances, frequency_khz)).tolist() == [True, False, False, True]


@law
@given(frequency_khz=frequencies_khz, share=st.floats(0.001, 0.99), further=st.floats(0.001, 0.009))
def test_beta_star_rises_with_distance(frequency_khz, share, further):
    near, far = balance_distance_m(np.array([BETA_MIN, BETA_MAX]), frequency_khz)
    one, other = star(near + (far - near) * np.array([share, share + further]), frequency_khz)
    assert BETA_MIN < one < other < BETA_MAX


@law
@given(packet_bits=bits, stored_share=st.floats(0, 1.1), log_harvest_share=st.floats(-3, 4))
def test_smallest_beta_is_the_first_that_pays(packet_bits, stored_share, log_harvest_share):
    least_j = required_j(BETA_MIN, packet_bits)
    assert_smallest_beta_that_pays(
        stored_share * least_j, 10**log_harvest_share * least_j / SLOT_S, packet_bits
    )


@law
@given(
    packet_bits=bits,
    turning_beta=st.floats(0.1, 0.95),
    log_margin=st.floats(-11, -1),
    sign=st.sampled_from([-1, 1]),
)
def test_smallest_beta_is_right_where_the_balance_barely_turns(
    packet_bits, turning_beta, log_margin, sign
):
    power_w = required_slope_w(turning_beta, packet_bits)
    touching_j = required_j(turning_beta, packet_bits) - turning_beta * SLOT_S * power_w
    margin_j = sign * 10**log_margin * required_j(turning_beta, packet_bits)
    assert_smallest_beta_that_pays(touching_j + margin_j, power_w, packet_bits)


@pytest.mark.parametrize(
    ("stored_share", "harvest_share", "beta"),
    [
        pytest.param(1.01, 0, BETA_MIN, id="stored energy pays"),
        pytest.param(0, 20, BETA_MIN, id="least charging has a surplus"),
        pytest.param(0, 2, 0.5, id="harvest pays half way"),
        pytest.param(0.5, 1, 0.5, id="store and harvest share the cost"),
        pytest.param(0.9, 0.01, math.nan, id="too little harvest"),
        pytest.param(0, 0, math.nan, id="nothing at all"),
    ],
)
def test_smallest_beta_in_each_regime(stored_share, harvest_share, beta):
    required = required_j(0.5, PACKET_BITS)
    computed = smallest_beta(
        stored_share * required, harvest_share * required / SLOT_S, 1, *SLOT, BETA_MIN, BETA_MAX
    )
    assert computed == pytest.approx(beta, rel=1e-9, nan_ok=True)


@law
@given(packet_bits=bits, beta=betas)
def test_g_slope_equals_finite_differences_of_g(packet_bits, beta):
    step = 1e-4 * beta * (1 - beta)
    slot = (SLOT_S, packet_bits, BANDWIDTH_HZ)
    below, above = g(np.array([beta - step, beta + step]), *slot)
    scale = 1 / (beta * (1 - beta))
    assert g_slope(beta, *slot) == pytest.approx((above - below) / (2 * step), abs=1e-6 * scale)


@law
@given(beta=betas, further=st.floats(0.001, 0.04))
def test_g_rises_with_beta_for_the_packet_of_the_paper(beta, further):
    low, high = g(np.array([beta, beta + further]), *SLOT)
    assert low < high
    assert g_slope(beta, *SLOT) > 0


@law
@given(beta=betas, distance_m=st.floats(1, 3000))
def test_g_minus_h_is_the_log_ratio_of_harvested_to_required_energy(beta, distance_m):
    attenuation = attenuation_db(distance_m)
    harvested = beta * SLOT_S * harvested_w(attenuation)
    required = required_j(beta, PACKET_BITS) * transmit_power_w(1, attenuation, NOISE_DB)
    excess = g(beta, *SLOT) - h(attenuation, KAPPA_3)
    assert excess == pytest.approx(math.log10(harvested / required), abs=1e-9)


@law
@given(attenuation=st.floats(0, 100))
def test_kappa_2_is_the_power_harvested_without_attenuation(attenuation):
    assert KAPPA_2 * 10 ** (-attenuation / 10) == pytest.approx(harvested_w(attenuation), rel=1e-12)


@law
@given(attenuation=st.floats(-50, 100))
def test_attenuation_at_balance_inverts_h(attenuation):
    balanced = attenuation_at_balance_db(h(attenuation, KAPPA_3), KAPPA_3)
    assert balanced == pytest.approx(attenuation, abs=1e-9)


@pytest.mark.parametrize(
    ("loss", "spreading_db_per_decade"), [(table_attenuation_db, 1.5), (transmission_loss_db, 15)]
)
@law
@given(distance_m=st.floats(1.001, 1e5), frequency_khz=frequencies_khz)
def test_attenuation_distance_inverts_the_loss(
    loss, spreading_db_per_decade, distance_m, frequency_khz
):
    absorption = thorp_absorption_db_per_km(frequency_khz)
    loss_db = loss(distance_m, absorption, 1.5)
    distance = attenuation_distance_m(loss_db, absorption, spreading_db_per_decade)
    assert distance == pytest.approx(distance_m, rel=1e-9)


def test_attenuation_reached_within_one_metre_has_no_distance():
    distances = attenuation_distance_m(np.array([-1, 0, 0.0099, 0.0101]), 10, 1.5)
    assert np.isnan(distances).tolist() == [True, True, True, False]


@pytest.mark.parametrize("beta_min", [0.0, 0.3])
def test_steps_that_numpy_is_spared_would_change_no_digit(beta_min):
    """An array of another library is never asked whether steps have come to an end."""
    rng = np.random.default_rng(0)
    stored_j, power_w, cost_w = 10 ** rng.uniform(-6, 1, (3, 2000))
    rest = (SLOT_S, 60_000, BANDWIDTH_HZ, beta_min, BETA_MAX)
    found = smallest_beta(stored_j, power_w, cost_w, *rest)
    strict = map(array_api_strict.asarray, (stored_j, power_w, cost_w))
    np.testing.assert_array_equal(found, np.asarray(smallest_beta(*strict, *rest)))
    assert np.count_nonzero(found > beta_min) > 20
    assert np.count_nonzero(found == beta_min) > 20
    assert np.count_nonzero(np.isnan(found)) > 20
