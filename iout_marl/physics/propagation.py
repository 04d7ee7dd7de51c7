"""Loss of level between source and receiver, and the levels at both ends.

Two forms of the loss are in use (the reproduction of the paper needs the first):

- `table_attenuation_db`: k_s·log₁₀ d + α d, the form of the paper's appendix, which
  reproduces its table of energies and its results;
- `transmission_loss_db`: k_s·10·log₁₀ d + α d, the paper's eq. `AL` as printed and the
  loss of the sonar equation.
"""

from __future__ import annotations

from iout_marl.physics.arrays import Array, ArrayLike, as_arrays
from iout_marl.physics.formula import EFFICIENCY, NOT_NEGATIVE, POSITIVE, REAL, formula, within

#: Level of 1 W of acoustic power, 1 m from an omnidirectional source, in dB re 1 µPa.
REFERENCE_LEVEL_DB = 170.8
#: Density of sea water in kg/m³ and speed of sound in it in m/s, as rounded as they are used:
#: a plane wave of 1 µPa then carries 6.5·10⁻¹⁹ W/m².
SEA_WATER_KG_PER_M3, SOUND_SPEED_M_PER_S = 1025.0, 1500.0
#: Spreading factors k_s: none in a duct, 1 cylindrical, 2 spherical, more over a lossy bottom.
SPREADING = within(0, 4)


def _loss_db(
    distance_m: ArrayLike, absorption_db_per_km: ArrayLike, spreading_db_per_decade: ArrayLike
) -> Array:
    xp, d, alpha, spreading = as_arrays(distance_m, absorption_db_per_km, spreading_db_per_decade)
    # Levels are referred to 1 m: nearer than that nothing spreads.
    return spreading * xp.log10(xp.where(d > 1, d, xp.ones_like(d))) + alpha * d / 1000


@formula(distance_m=NOT_NEGATIVE, absorption_db_per_km=NOT_NEGATIVE, spreading_factor=SPREADING)
def table_attenuation_db(
    distance_m: ArrayLike, absorption_db_per_km: ArrayLike, spreading_factor: ArrayLike = 1.5
) -> Array:
    """Attenuation level as the paper's appendix writes it: AL = k_s log₁₀ d + κ₄ d.

    Its own eq. `AL` has 10 k_s in place of k_s, but its table of energies and its
    results follow this form.

    Args:
        distance_m: distance d in m, not negative; no spreading below 1 m.
        absorption_db_per_km: absorption α = κ₄ in dB/km, not negative.
        spreading_factor: k_s, 1 (cylindrical) to 2 (spherical), at most 4.

    Returns:
        AL in dB, in the broadcast shape of the arguments.

    Raises:
        InputError: an argument lies outside its range.
    """
    return _loss_db(distance_m, absorption_db_per_km, spreading_factor)


@formula(distance_m=NOT_NEGATIVE, absorption_db_per_km=NOT_NEGATIVE, spreading_factor=SPREADING)
def transmission_loss_db(
    distance_m: ArrayLike, absorption_db_per_km: ArrayLike, spreading_factor: ArrayLike = 1.5
) -> Array:
    """Transmission loss of the sonar equation: TL = k_s·10 log₁₀ d + α d (eq. `AL`).

    Args and errors as for `table_attenuation_db`.

    Returns:
        TL in dB re 1 m, in the broadcast shape of the arguments.
    """
    _, d, alpha, spreading = as_arrays(distance_m, absorption_db_per_km, spreading_factor)
    return _loss_db(d, alpha, 10 * spreading)


@formula(electrical_power_w=POSITIVE, efficiency=EFFICIENCY, directivity_index_db=REAL)
def source_level_db(
    electrical_power_w: ArrayLike, efficiency: ArrayLike, directivity_index_db: ArrayLike = 0.0
) -> Array:
    """Source level SL = 170.8 + 10 log₁₀ P_elec + 10 log₁₀ η + DI (eq. `SL`).

    Args:
        electrical_power_w: electrical input power P_elec in W, above 0.
        efficiency: electro-acoustic efficiency η, above 0 and at most 1.
        directivity_index_db: DI in dB.

    Returns:
        SL in dB re 1 µPa at 1 m, in the broadcast shape of the arguments.

    Raises:
        InputError: an argument lies outside its range.
    """
    xp, power, eta, di = as_arrays(electrical_power_w, efficiency, directivity_index_db)
    return REFERENCE_LEVEL_DB + 10 * xp.log10(power) + 10 * xp.log10(eta) + di


@formula(source_level_db=REAL, efficiency=EFFICIENCY, directivity_index_db=REAL)
def electrical_power_w(
    source_level_db: ArrayLike, efficiency: ArrayLike, directivity_index_db: ArrayLike = 0.0
) -> Array:
    """Electrical power that a source level takes: eq. `SL` solved for P_elec.

    Args:
        source_level_db: SL in dB re 1 µPa at 1 m.
        efficiency: electro-acoustic efficiency η, above 0 and at most 1.
        directivity_index_db: DI in dB.

    Returns:
        P_elec in W, in the broadcast shape of the arguments.

    Raises:
        InputError: an argument lies outside its range.
    """
    _, level, eta, di = as_arrays(source_level_db, efficiency, directivity_index_db)
    return 10 ** ((level - REFERENCE_LEVEL_DB - di) / 10) / eta


@formula(source_level_db=REAL, attenuation_db=REAL, noise_level_db=REAL)
def received_level_db(
    source_level_db: ArrayLike, attenuation_db: ArrayLike, noise_level_db: ArrayLike = 0.0
) -> Array:
    """Received level RL = SL − AL − NL (eq. `RL`).

    The paper subtracts the noise level from the energy signal too; with
    `noise_level_db=0` this is the passive sonar equation's RL = SL − TL.

    Returns:
        RL in dB re 1 µPa, in the broadcast shape of the arguments.
    """
    _, sl, al, nl = as_arrays(source_level_db, attenuation_db, noise_level_db)
    return sl - al - nl


@formula(received_level_db=REAL)
def intensity_w_per_m2(received_level_db: ArrayLike) -> Array:
    """Intensity of a plane wave, I = p²/(ρ c) with p = 10^(RL/20) µPa.

    With ρ = 1025 kg/m³ and c = 1500 m/s, 0 dB re 1 µPa is 6.5·10⁻¹⁹ W/m².

    Args:
        received_level_db: RL in dB re 1 µPa.

    Returns:
        intensity in W/m², in the shape of the levels.
    """
    _, level = as_arrays(received_level_db)
    impedance = SEA_WATER_KG_PER_M3 * SOUND_SPEED_M_PER_S
    return 10 ** (level / 10) * (1e-12 / impedance)


@formula(distance_m=NOT_NEGATIVE)
def round_trip_s(distance_m: ArrayLike) -> Array:
    """Time for a call and its answer, 2 d/c with c = 1500 m/s, in s.

    Args:
        distance_m: distance d in m, not negative.

    Raises:
        InputError: a distance is negative.
    """
    _, d = as_arrays(distance_m)
    return 2 * d / SOUND_SPEED_M_PER_S
