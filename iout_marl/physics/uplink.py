"""Information uplink: what a node must spend to deliver a packet."""

from __future__ import annotations

import math

from iout_marl.physics.arrays import Array, ArrayLike, as_arrays
from iout_marl.physics.formula import EFFICIENCY, NOT_NEGATIVE, POSITIVE, REAL, formula
from iout_marl.physics.propagation import electrical_power_w


@formula(packet_bits=POSITIVE, duration_s=POSITIVE, bandwidth_hz=POSITIVE)
def required_snr(packet_bits: ArrayLike, duration_s: ArrayLike, bandwidth_hz: ArrayLike) -> Array:
    """SNR that carries a packet in the time given, γ = 2^(S/B) − 1 with S = L_t/t (eq. `snr`).

    Args:
        packet_bits: L_t in bits, above 0.
        duration_s: time t for the packet in s, above 0.
        bandwidth_hz: B in Hz, above 0.

    Returns:
        γ as a ratio (not in dB), in the broadcast shape of the arguments; inf where it is
        larger than any number of its type.

    Raises:
        InputError: an argument is not above 0.
    """
    xp, bits, duration, bandwidth = as_arrays(packet_bits, duration_s, bandwidth_hz)
    return xp.expm1(math.log(2) * bits / (duration * bandwidth))


@formula(snr=NOT_NEGATIVE, attenuation_db=REAL, noise_level_db=REAL)
def transmit_power_w(snr: ArrayLike, attenuation_db: ArrayLike, noise_level_db: ArrayLike) -> Array:
    """Transmit power of the paper, P_trans = γ·10^(NL/10)·10^(AL/10) (eq. `p transmit`).

    The paper reads the level of the right-hand side as watts. `sonar_transmit_power_w`
    is the same balance in consistent units.

    Returns:
        power in W, in the broadcast shape of the arguments.

    Raises:
        InputError: an SNR is negative.
    """
    _, gamma, al, nl = as_arrays(snr, attenuation_db, noise_level_db)
    return gamma * 10 ** ((nl + al) / 10)


@formula(
    snr=NOT_NEGATIVE,
    transmission_loss_db=REAL,
    noise_band_level_db=REAL,
    efficiency=EFFICIENCY,
    directivity_index_db=REAL,
)
def sonar_transmit_power_w(
    snr: ArrayLike,
    transmission_loss_db: ArrayLike,
    noise_band_level_db: ArrayLike,
    efficiency: ArrayLike,
    directivity_index_db: ArrayLike = 0.0,
) -> Array:
    """Electrical power by the sonar equation: SL = TL + NL + 10 log₁₀ γ through eq. `SL`.

    Args:
        snr: γ at the receiver, as a ratio, not negative.
        transmission_loss_db: TL in dB re 1 m.
        noise_band_level_db: noise in the band in dB re 1 µPa².
        efficiency: electro-acoustic efficiency η of the node's transmitter, above 0 and at
            most 1.
        directivity_index_db: DI of the node's transmitter in dB.

    Returns:
        power in W, in the broadcast shape of the arguments.

    Raises:
        InputError: an argument lies outside its range.
    """
    _, gamma, tl, nl, eta, di = as_arrays(
        snr, transmission_loss_db, noise_band_level_db, efficiency, directivity_index_db
    )
    return gamma * electrical_power_w.unchecked(tl + nl, eta, di)


@formula(power_w=NOT_NEGATIVE, uplink_s=NOT_NEGATIVE)
def required_energy_j(power_w: ArrayLike, uplink_s: ArrayLike) -> Array:
    """Energy of an uplink, E_req = P_trans·τ_data (eq. `E transmited`), in J.

    Raises:
        InputError: a power or a duration is negative.
    """
    _, power, duration = as_arrays(power_w, uplink_s)
    return power * duration


@formula(packet_bits=POSITIVE, bit_rate_bps=POSITIVE)
def airtime_s(packet_bits: ArrayLike, bit_rate_bps: ArrayLike) -> Array:
    """How long a modem sends a packet, L/R, in s.

    Args:
        packet_bits: L in bits, above 0.
        bit_rate_bps: R in bit/s, above 0.

    Raises:
        InputError: an argument is not above 0.
    """
    _, bits, rate = as_arrays(packet_bits, bit_rate_bps)
    return bits / rate


@formula(
    transmit_power_w=NOT_NEGATIVE,
    electronics_power_w=NOT_NEGATIVE,
    packet_bits=POSITIVE,
    bit_rate_bps=POSITIVE,
)
def modem_energy_j(
    transmit_power_w: ArrayLike,
    electronics_power_w: ArrayLike,
    packet_bits: ArrayLike,
    bit_rate_bps: ArrayLike,
) -> Array:
    """Energy that a modem takes for a packet, (P_electronics + P_trans)·L/R, in J.

    Args:
        transmit_power_w: electric power of the transmitter in W, see `sonar_transmit_power_w`;
            not negative.
        electronics_power_w: what everything else draws meanwhile, in W, not negative.
        packet_bits: L in bits, above 0.
        bit_rate_bps: R in bit/s, above 0.

    Raises:
        InputError: an argument lies outside its range.
    """
    _, transmit, electronics, airtime = as_arrays(
        transmit_power_w, electronics_power_w, airtime_s.unchecked(packet_bits, bit_rate_bps)
    )
    return (electronics + transmit) * airtime


@formula(attenuation_db=REAL, kappa=NOT_NEGATIVE)
def approximate_required_energy_j(attenuation_db: ArrayLike, kappa: ArrayLike) -> Array:
    """The paper's E_req ≈ κ·10^(AL/10), free of β (eq. `e_req_approximation`), in J.

    Args:
        attenuation_db: AL in dB.
        kappa: κ of `splitting.kappa`, 23.105 for the paper's values; not negative.

    Raises:
        InputError: a κ is negative.
    """
    _, al, k = as_arrays(attenuation_db, kappa)
    return k * 10 ** (al / 10)
