"""Ambient noise of the sea: Wenz's curves in the formulas of Coates."""

from __future__ import annotations

import numpy as np

from iout_marl.physics.arrays import Array, ArrayLike, as_arrays, require


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
        frequency_khz: frequency in kHz, above 0.
        shipping: shipping activity s, from 0 (none) to 1 (heavy).
        wind_m_per_s: wind speed w at the surface in m/s, not negative.

    Returns:
        noise level in dB re 1 µPa²/Hz, in the broadcast shape of the arguments.

    Raises:
        ValueError: an argument is outside its range.
    """
    xp, f, s, w = as_arrays(frequency_khz, shipping, wind_m_per_s)
    require(f > 0, "frequency_khz must be above 0")
    require((s >= 0) & (s <= 1), "shipping must lie between 0 and 1")
    require(w >= 0, "wind_m_per_s must not be negative")
    log_f = xp.log10(f)
    turbulence = 17 - 30 * log_f
    ships = 40 + 20 * (s - 0.5) + 26 * log_f - 60 * xp.log10(f + 0.03)
    wind = 50 + 7.5 * xp.sqrt(w) + 20 * log_f - 40 * xp.log10(f + 0.4)
    thermal = -15 + 20 * log_f
    return 10 * xp.log10(
        10 ** (turbulence / 10) + 10 ** (ships / 10) + 10 ** (wind / 10) + 10 ** (thermal / 10)
    )


def ambient_noise_band_level_db(
    frequency_khz: float, bandwidth_hz: float, shipping: float = 0.5, wind_m_per_s: float = 0.0
) -> float:
    """Level of the ambient noise in a band: its spectral level integrated over the band.

    Gauss-Legendre quadrature in log f of eq. 10 log₁₀ ∫ 10^(N(f)/10) df over the
    `bandwidth_hz` around `frequency_khz`.

    Args:
        frequency_khz: centre of the band in kHz.
        bandwidth_hz: width of the band in Hz, above 0 and below twice the centre.
        shipping: shipping activity, 0 to 1.
        wind_m_per_s: wind speed in m/s.

    Returns:
        noise level in dB re 1 µPa².

    Raises:
        ValueError: the band reaches down to 0 Hz, or an argument is outside its range.
    """
    if not 0 < bandwidth_hz < 2e3 * frequency_khz:
        raise ValueError("bandwidth_hz must be above 0 and keep the band above 0 Hz")
    nodes, weights = np.polynomial.legendre.leggauss(32)
    low_khz, high_khz = frequency_khz - bandwidth_hz / 2e3, frequency_khz + bandwidth_hz / 2e3
    half_log = np.log(high_khz / low_khz) / 2
    band_khz = np.sqrt(low_khz * high_khz) * np.exp(nodes * half_log)
    density = 10 ** (ambient_noise_spectral_level_db(band_khz, shipping, wind_m_per_s) / 10)
    return float(10 * np.log10(np.sum(weights * density * band_khz * 1e3) * half_log))
