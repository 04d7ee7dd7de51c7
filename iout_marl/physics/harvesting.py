"""Acoustic energy transfer: from the received level to joules in the node's store."""

from __future__ import annotations

from iout_marl.physics.arrays import Array, ArrayLike, as_arrays
from iout_marl.physics.formula import COUNT, EFFICIENCY, NOT_NEGATIVE, POSITIVE, REAL, formula
from iout_marl.physics.propagation import intensity_w_per_m2


@formula(received_level_db=REAL, sensitivity_db=REAL)
def induced_voltage_v(received_level_db: ArrayLike, sensitivity_db: ArrayLike) -> Array:
    """Voltage at the open hydrophone, V_ind = p·M = 10^((RL + RVS)/20) (eq. `v ind`).

    Args:
        received_level_db: RL in dB re 1 µPa.
        sensitivity_db: receiving voltage sensitivity RVS = 20 log₁₀ M in dB re 1 V/µPa
            (eq. `rvs`).

    Returns:
        voltage in V, in the broadcast shape of the arguments.
    """
    _, rl, rvs = as_arrays(received_level_db, sensitivity_db)
    return 10 ** ((rl + rvs) / 20)


@formula(voltage_v=NOT_NEGATIVE, load_resistance_ohm=POSITIVE)
def available_power_w(voltage_v: ArrayLike, load_resistance_ohm: ArrayLike) -> Array:
    """Power into a matched load, P_available = V_ind²/(4 R_p) (eq. `p available`).

    Args:
        voltage_v: V_ind in V, its effective value: not negative.
        load_resistance_ohm: R_p in Ω, above 0.

    Returns:
        power in W, in the broadcast shape of the arguments.

    Raises:
        InputError: an argument lies outside its range.
    """
    _, voltage, resistance = as_arrays(voltage_v, load_resistance_ohm)
    return voltage**2 / (4 * resistance)


@formula(
    received_level_db=REAL,
    sensitivity_db=REAL,
    load_resistance_ohm=POSITIVE,
    efficiency=EFFICIENCY,
    hydrophones=COUNT,
)
def harvested_power_w(
    received_level_db: ArrayLike,
    sensitivity_db: ArrayLike,
    load_resistance_ohm: ArrayLike,
    efficiency: ArrayLike,
    hydrophones: ArrayLike = 1,
) -> Array:
    """Power that a node harvests, P_harv = n·η·10^((RL+RVS)/10)/(4 R_p) (eq. `p harvested`).

    Args:
        received_level_db: RL in dB re 1 µPa.
        sensitivity_db: RVS in dB re 1 V/µPa.
        load_resistance_ohm: R_p in Ω, above 0.
        efficiency: acoustic-electric efficiency η, above 0 and at most 1.
        hydrophones: number n of hydrophones, 1 or more; the paper's equation is for one.

    Returns:
        power in W, in the broadcast shape of the arguments.

    Raises:
        InputError: an argument lies outside its range.
    """
    voltage = induced_voltage_v.unchecked(received_level_db, sensitivity_db)
    _, available, eta, n = as_arrays(
        available_power_w.unchecked(voltage, load_resistance_ohm), efficiency, hydrophones
    )
    return n * eta * available


@formula(received_level_db=REAL, area_m2=POSITIVE, acoustic_power_w=NOT_NEGATIVE)
def incident_power_w(
    received_level_db: ArrayLike, area_m2: ArrayLike, acoustic_power_w: ArrayLike
) -> Array:
    """Sound that passes through an area, min(I·A, P_acoustic): never more than is emitted.

    Near a source of high directivity I·A alone would exceed it.

    Args:
        received_level_db: RL in dB re 1 µPa, that of real pressures.
        area_m2: A in m², above 0.
        acoustic_power_w: P_acoustic of the source in W, not negative.

    Returns:
        power in W, in the broadcast shape of the arguments.

    Raises:
        InputError: an argument lies outside its range.
    """
    xp, level, area, emitted = as_arrays(received_level_db, area_m2, acoustic_power_w)
    passing = intensity_w_per_m2.unchecked(level) * area
    return xp.where(passing < emitted, passing, emitted)


@formula(
    received_level_db=REAL,
    area_m2=POSITIVE,
    acoustic_power_w=NOT_NEGATIVE,
    efficiency=EFFICIENCY,
    threshold_w=NOT_NEGATIVE,
)
def aperture_power_w(
    received_level_db: ArrayLike,
    area_m2: ArrayLike,
    acoustic_power_w: ArrayLike,
    efficiency: ArrayLike,
    threshold_w: ArrayLike = 0.0,
) -> Array:
    """Power that a receiver of a known aperture harvests, η min(I·A, P_acoustic).

    Nothing is harvested where what passes the aperture stays below the rectifier's threshold.

    Args:
        received_level_db: RL in dB re 1 µPa, that of real pressures.
        area_m2: aperture A in m², above 0.
        acoustic_power_w: P_acoustic of the source in W, not negative.
        efficiency: acoustic-electric efficiency η, above 0 and at most 1.
        threshold_w: acoustic power from which on the rectifier works, in W, not negative.

    Returns:
        power in W, in the broadcast shape of the arguments.

    Raises:
        InputError: an argument lies outside its range.
    """
    xp, incident, eta, threshold = as_arrays(
        incident_power_w.unchecked(received_level_db, area_m2, acoustic_power_w),
        efficiency,
        threshold_w,
    )
    return xp.where(incident >= threshold, eta * incident, xp.zeros_like(incident))


@formula(power_w=NOT_NEGATIVE, charging_s=NOT_NEGATIVE)
def harvested_energy_j(power_w: ArrayLike, charging_s: ArrayLike) -> Array:
    """Energy harvested, E_harv = P_harv·τ_charging (eq. `E harvested`), in J.

    Raises:
        InputError: a power or a duration is negative.
    """
    _, power, duration = as_arrays(power_w, charging_s)
    return power * duration
