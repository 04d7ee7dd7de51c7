"""Absorption of sound in sea water, in dB per km."""

from __future__ import annotations

from iout_marl.physics.arrays import Array, ArrayLike, as_arrays
from iout_marl.physics.formula import (
    DEPTH_M,
    FREQUENCY_KHZ,
    TEMPERATURE_C,
    Domain,
    formula,
    within,
)


@formula(frequency_khz=FREQUENCY_KHZ)
def thorp_absorption_db_per_km(frequency_khz: ArrayLike) -> Array:
    """Absorption by Thorp's formula (paper's eq. `alpha(f)`).

    α(f) = 0.11 f²/(f²+1) + 44 f²/(f²+4100) + 2.75·10⁻⁴ f² + 0.003, f in kHz, for
    frequencies above a few hundred Hz.

    Args:
        frequency_khz: frequency in kHz, above 0 and at most 10,000, of any shape.

    Returns:
        α in dB/km, in the shape of `frequency_khz`.

    Raises:
        InputError: a frequency is another one.
    """
    _, f = as_arrays(frequency_khz)
    f2 = f**2
    return 0.11 * f2 / (f2 + 1) + 44 * f2 / (f2 + 4100) + 2.75e-4 * f2 + 0.003


@formula(
    frequency_khz=FREQUENCY_KHZ,
    temperature_c=TEMPERATURE_C,
    salinity_psu=Domain("be above 0 and at most 50 (PSU)", lambda x, _: (x > 0) & (x <= 50)),
    depth_m=DEPTH_M,
    ph=within(6, 9),
)
def francois_garrison_absorption_db_per_km(
    frequency_khz: ArrayLike,
    temperature_c: ArrayLike = 10.0,
    salinity_psu: ArrayLike = 35.0,
    depth_m: ArrayLike = 100.0,
    ph: ArrayLike = 8.0,
) -> Array:
    """Absorption by Francois and Garrison: boric acid, magnesium sulphate, pure water.

    R. E. Francois and G. R. Garrison, 'Sound absorption based on ocean measurements',
    parts I and II, J. Acoust. Soc. Am. 72 (1982), pp. 896 and 1879. Good to 5 % from
    0.2 to 1000 kHz, −2 to 30 °C, 30 to 35 PSU and down to 3.5 km.

    Args:
        frequency_khz: frequency in kHz, above 0 and at most 10,000.
        temperature_c: water temperature, −2 to 40 °C.
        salinity_psu: practical salinity, above 0 and at most 50.
        depth_m: depth, 0 to 11,000 m.
        ph: acidity, 6 to 9.

    Returns:
        α in dB/km, in the broadcast shape of the arguments.

    Raises:
        InputError: an argument lies outside its range.
    """
    xp, f, t, s, z, ph = as_arrays(frequency_khz, temperature_c, salinity_psu, depth_m, ph)
    f2 = f**2
    sound_speed = 1412 + 3.21 * t + 1.19 * s + 0.0167 * z  # their own fit, not Mackenzie's

    boric_khz = 2.8 * xp.sqrt(s / 35) * 10 ** (4 - 1245 / (t + 273))
    boric = 8.86 / sound_speed * 10 ** (0.78 * ph - 5)

    magnesium_khz = 8.17 * 10 ** (8 - 1990 / (t + 273)) / (1 + 0.0018 * (s - 35))
    magnesium = 21.44 * s / sound_speed * (1 + 0.025 * t) * (1 - 1.37e-4 * z + 6.2e-9 * z**2)

    water = xp.where(
        t <= 20,
        4.937e-4 - 2.59e-5 * t + 9.11e-7 * t**2 - 1.50e-8 * t**3,
        3.964e-4 - 1.146e-5 * t + 1.45e-7 * t**2 - 6.5e-10 * t**3,
    ) * (1 - 3.83e-5 * z + 4.9e-10 * z**2)

    return (
        boric * boric_khz * f2 / (f2 + boric_khz**2)
        + magnesium * magnesium_khz * f2 / (f2 + magnesium_khz**2)
        + water * f2
    )
