"""Speed of sound in sea water."""

from __future__ import annotations

from iout_marl.physics.arrays import Array, ArrayLike, as_arrays
from iout_marl.physics.formula import DEPTH_M, TEMPERATURE_C, formula, within


@formula(temperature_c=TEMPERATURE_C, salinity_psu=within(0, 50, " (PSU)"), depth_m=DEPTH_M)
def mackenzie_sound_speed_m_per_s(
    temperature_c: ArrayLike, salinity_psu: ArrayLike, depth_m: ArrayLike
) -> Array:
    """Speed of sound by Mackenzie's nine-term equation.

    K. V. Mackenzie, 'Nine-term equation for sound speed in the oceans', J. Acoust.
    Soc. Am. 70 (1981), p. 807. Standard error 0.07 m/s from −2 to 30 °C, 25 to 40 PSU
    and down to 8 km.

    Args:
        temperature_c: water temperature, −2 to 40 °C.
        salinity_psu: practical salinity, 0 to 50.
        depth_m: depth, 0 to 11,000 m.

    Returns:
        sound speed in m/s, in the broadcast shape of the arguments.

    Raises:
        InputError: an argument lies outside its range.
    """
    _, t, s, z = as_arrays(temperature_c, salinity_psu, depth_m)
    s = s - 35
    return (
        1448.96
        + 4.591 * t
        - 5.304e-2 * t**2
        + 2.374e-4 * t**3
        + 1.340 * s
        + 1.630e-2 * z
        + 1.675e-7 * z**2
        - 1.025e-2 * t * s
        - 7.139e-13 * t * z**3
    )
