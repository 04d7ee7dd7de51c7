"""Ambient noise of the sea: Wenz's curves in the formulas of Coates."""

from __future__ import annotations

import functools

import numpy as np

from iout_marl.physics.arrays import Array, ArrayLike, as_arrays
from iout_marl.physics.formula import FRACTION, FREQUENCY_KHZ, Domain, formula, within

WIND_M_PER_S = within(0, 120, " (m/s)")


@formula(frequency_khz=FREQUENCY_KHZ, shipping=FRACTION, wind_m_per_s=WIND_M_PER_S)
def ambient_noise_spectral_level_db(
    frequency_khz: ArrayLike, shipping: ArrayLike = 0.5, wind_m_per_s: ArrayLike = 0.0
) -> Array:
    """Spectral level of turbulence, shipping, wind and thermal noise together.

    G. M. Wenz, J. Acoust. Soc. Am. 34 (1962), in the formulas of R. Coates,
    'Underwater Acoustic Systems' (1990), with f in kHz:

    - turbulence 17 − 30 log₁₀ f
    - shipping   40 + 20 (s − ½) + 26 log₁₀ f − 60 log₁₀(f + 0.03)
    - wind       50 + 7.5 √w + 20 log₁₀ f − 40 log₁₀(f + 0.4)
    - thermal    −15 + 20 log₁₀ f

    Args:
        frequency_khz: frequency in kHz, above 0 and at most 10,000.
        shipping: shipping activity s, from 0 (none) to 1 (heavy).
        wind_m_per_s: wind speed w at the surface, 0 to 120 m/s.

    Returns:
        noise level in dB re 1 µPa²/Hz, in the broadcast shape of the arguments.

    Raises:
        InputError: an argument lies outside its range.
    """
    xp, f, s, w = as_arrays(frequency_khz, shipping, wind_m_per_s)
    log_f = xp.log10(f)
    turbulence = 17 - 30 * log_f
    ships = 40 + 20 * (s - 0.5) + 26 * log_f - 60 * xp.log10(f + 0.03)
    wind = 50 + 7.5 * xp.sqrt(w) + 20 * log_f - 40 * xp.log10(f + 0.4)
    thermal = -15 + 20 * log_f
    return 10 * xp.log10(
        10 ** (turbulence / 10) + 10 ** (ships / 10) + 10 ** (wind / 10) + 10 ** (thermal / 10)
    )


@formula(
    frequency_khz=FREQUENCY_KHZ,
    bandwidth_hz=Domain(
        "be above 0 and keep the band above 0 Hz",
        lambda x, given: (x > 0) & (x < 2e3 * given["frequency_khz"]),
    ),
    shipping=FRACTION,
    wind_m_per_s=WIND_M_PER_S,
)
def ambient_noise_band_level_db(
    frequency_khz: ArrayLike,
    bandwidth_hz: ArrayLike,
    shipping: ArrayLike = 0.5,
    wind_m_per_s: ArrayLike = 0.0,
) -> Array:
    """Level of the ambient noise in a band: its spectral level integrated over the band.

    Gauss-Legendre quadrature in log f of eq. 10 log₁₀ ∫ 10^(N(f)/10) df over the
    `bandwidth_hz` around `frequency_khz`.

    Args:
        frequency_khz: centre of the band in kHz, above 0 and at most 10,000.
        bandwidth_hz: width of the band in Hz, above 0 and below twice the centre.
        shipping: shipping activity, 0 to 1.
        wind_m_per_s: wind speed, 0 to 120 m/s.

    Returns:
        noise level in dB re 1 µPa², in the broadcast shape of the arguments.

    Raises:
        InputError: the band reaches down to 0 Hz, or an argument lies outside its range.
    """
    xp, f, bandwidth, s, w = as_arrays(frequency_khz, bandwidth_hz, shipping, wind_m_per_s)
    _, nodes, weights, _ = as_arrays(*_quadrature(), f + bandwidth)
    low_khz, high_khz = f - bandwidth / 2e3, f + bandwidth / 2e3
    half_log = xp.log(high_khz / low_khz) / 2
    # The points of the quadrature lie along an axis of their own, the last.
    band_khz = xp.sqrt(low_khz * high_khz)[..., None] * xp.exp(nodes * half_log[..., None])
    level = ambient_noise_spectral_level_db.unchecked(band_khz, s[..., None], w[..., None])
    power = xp.sum(weights * 10 ** (level / 10) * band_khz * 1e3, axis=-1)
    return 10 * xp.log10(power * half_log)


@functools.cache
def _quadrature() -> tuple[list[float], list[float]]:
    """Points and weights of the Gauss-Legendre quadrature over −1 to 1."""
    points, weights = np.polynomial.legendre.leggauss(32)
    return points.tolist(), weights.tolist()
