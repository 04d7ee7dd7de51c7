"""How TDD splits a slot: charging for βτ, uplink for (1 − β)τ.

The energy balance of a node, with e joules stored at the start of the slot, is

    f(β) = e + β τ P_harv − E_req(β),   E_req(β) = u (2^(L_t/(uB)) − 1) C,  u = (1 − β) τ,

where C is the transmit power per unit of SNR. E_req is the perspective of a convex
function of 1/u, hence convex in β, hence f is concave. All higher derivatives of E_req
are positive too, so that right of any β the parabola with f's value, slope and bend lies
above f: from the left its root never oversteps the smallest root of f, and where it has
no root f has none. Newton's steps would be too slow, or miss that, where f barely turns.

The paper's β* is the root of f for e = 0 (E_harv = E_req); its appendix writes the
same as g(β) = h(d).
"""

from __future__ import annotations

import math

from iout_marl.physics.arrays import Array, ArrayLike, as_arrays, is_known_equal
from iout_marl.physics.formula import (
    COUNT,
    EFFICIENCY,
    NOT_NEGATIVE,
    POSITIVE,
    REAL,
    Domain,
    formula,
    within,
)
from iout_marl.physics.uplink import required_snr

#: Steps to the parabola's root; f is all but linear, so that three reach the last digit
#: in practice: all six are for a balance that barely turns.
PARABOLA_STEPS = 6
#: Halvings of the bracket in `attenuation_distance_m`, which is at most log₁₀ of the largest
#: number long: down to the last digit.
BISECTION_STEPS = 64
_BETA = Domain("lie strictly between 0 and 1", lambda x, _: (x > 0) & (x < 1))
_SLOT = {"slot_s": POSITIVE, "packet_bits": POSITIVE, "bandwidth_hz": POSITIVE}
_INTERVAL = _SLOT | {
    "beta_min": Domain("be at least 0 and below 1", lambda x, _: (x >= 0) & (x < 1)),
    "beta_max": Domain(
        "be above beta_min and below 1", lambda x, given: (x > given["beta_min"]) & (x < 1)
    ),
}


@formula(
    "no β of the interval pays",
    stored_j=REAL,
    harvested_power_w=NOT_NEGATIVE,
    power_per_snr_w=NOT_NEGATIVE,
    **_INTERVAL,
)
def smallest_beta(
    stored_j: ArrayLike,
    harvested_power_w: ArrayLike,
    power_per_snr_w: ArrayLike,
    slot_s: ArrayLike,
    packet_bits: ArrayLike,
    bandwidth_hz: ArrayLike,
    beta_min: ArrayLike,
    beta_max: ArrayLike,
) -> Array:
    """The smallest β in [β_min, β_max] for which stored and harvested energy pay the uplink.

    Args:
        stored_j: energy e stored at the start of the slot in J; negative for a debt.
        harvested_power_w: P_harv in W, not negative.
        power_per_snr_w: C, the transmit power per unit of SNR, in W, not negative.
        slot_s: τ in s, above 0.
        packet_bits: L_t in bits, above 0.
        bandwidth_hz: B in Hz, above 0.
        beta_min, beta_max: bounds, 0 ≤ β_min < β_max < 1.

    Returns:
        β in the broadcast shape of the arguments; NaN where no β of the interval pays.

    Raises:
        InputError: an argument lies outside its range.
    """
    xp, stored, harvested, cost = as_arrays(stored_j, harvested_power_w, power_per_snr_w)

    def balance_slope_and_bend(beta: Array) -> tuple[Array, Array, Array]:
        uplink_s = (1 - beta) * slot_s
        snr = required_snr.unchecked(packet_bits, uplink_s, bandwidth_hz)
        exponent = math.log(2) * packet_bits / (uplink_s * bandwidth_hz)
        required_slope = slot_s * cost * ((snr + 1) * exponent - snr)
        return (
            stored + beta * slot_s * harvested - uplink_s * snr * cost,
            slot_s * harvested - required_slope,
            slot_s**2 * cost * (snr + 1) * exponent**2 / uplink_s,
        )

    beta = xp.zeros_like(stored + harvested + cost) + beta_min
    no_root = beta < 0
    beyond = xp.zeros_like(beta) + 0.5 * (1 + beta_max)
    for _ in range(PARABOLA_STEPS):
        balance, slope, bend = balance_slope_and_bend(beta)
        short = balance < 0
        rise = xp.where(slope > 0, slope, xp.ones_like(slope))
        newton_step = -balance / rise
        discriminant = 1 - 2 * newton_step * (bend / rise)
        # Short of energy, and more charging never makes up for the shorter uplink.
        no_root = no_root | (short & ((slope <= 0) | (discriminant < 0)))
        moves = short & ~no_root
        stretch = 2 / (1 + xp.sqrt(xp.where(moves, discriminant, xp.ones_like(beta))))
        before = beta
        beta = xp.where(moves, beta + newton_step * stretch, beta)
        # Keeps (1 − β) away from 0; a root out here is out of bounds all the same.
        beta = xp.where(beta > beta_max, beyond, beta)
        if is_known_equal(xp, before, beta):  # further steps would change nothing
            break
    return xp.where(no_root | (beta > beta_max), xp.full_like(beta, math.nan), beta)


@formula(
    "the interval holds no root",
    harvested_power_w=NOT_NEGATIVE,
    power_per_snr_w=NOT_NEGATIVE,
    **_INTERVAL,
)
def beta_star(
    harvested_power_w: ArrayLike,
    power_per_snr_w: ArrayLike,
    slot_s: ArrayLike,
    packet_bits: ArrayLike,
    bandwidth_hz: ArrayLike,
    beta_min: ArrayLike = 0.1,
    beta_max: ArrayLike = 0.9,
) -> Array:
    """The paper's β*: the root in [β_min, β_max] at which E_harv(β) rises to E_req(β).

    The paper takes the balance to rise with β throughout. For packets so large that it
    falls again as the uplink is left too little time, the root on the falling side is
    none: there a smaller β pays as well.

    Args and errors as for `smallest_beta`.

    Returns:
        β* in the broadcast shape of the arguments; NaN where the interval
        holds no root (the node is so near that β_min already harvests more than the
        uplink takes, or so far that β_max does not suffice).
    """
    xp, harvested, cost = as_arrays(harvested_power_w, power_per_snr_w)
    interval = (slot_s, packet_bits, bandwidth_hz, beta_min, beta_max)
    beta = smallest_beta.unchecked(xp.zeros_like(harvested + cost), harvested, cost, *interval)
    uplink_s = (1 - beta_min) * slot_s
    snr = required_snr.unchecked(packet_bits, uplink_s, bandwidth_hz)
    _, required_per_cost, _ = as_arrays(uplink_s * snr, cost)
    surplus_at_minimum = beta_min * slot_s * harvested > required_per_cost * cost
    return xp.where(surplus_at_minimum, xp.full_like(beta, math.nan), beta)


@formula(packet_bits=POSITIVE, bandwidth_hz=POSITIVE, noise_level_db=REAL)
def kappa(packet_bits: ArrayLike, bandwidth_hz: ArrayLike, noise_level_db: ArrayLike) -> Array:
    """κ = L_t ln 2 / B · 10^(NL/10), in J: E_req ≈ κ·10^(AL/10).

    Raises:
        InputError: a packet or a bandwidth is not above 0.
    """
    _, bits, bandwidth, nl = as_arrays(packet_bits, bandwidth_hz, noise_level_db)
    return bits * math.log(2) / bandwidth * 10 ** (nl / 10)


@formula(
    source_level_db=REAL,
    noise_level_db=REAL,
    sensitivity_db=REAL,
    load_resistance_ohm=POSITIVE,
    efficiency=EFFICIENCY,
    hydrophones=COUNT,
)
def kappa_2(
    source_level_db: ArrayLike,
    noise_level_db: ArrayLike,
    sensitivity_db: ArrayLike,
    load_resistance_ohm: ArrayLike,
    efficiency: ArrayLike,
    hydrophones: ArrayLike = 1,
) -> Array:
    """κ₂ = n η/(4 R_p)·10^((RVS + SL − NL)/10), in W: E_harv = β τ κ₂ 10^(−AL/10).

    Args and errors as for `harvested_power_w`, with the levels of source and noise.
    """
    _, sl, nl, rvs, resistance, eta, n = as_arrays(
        source_level_db,
        noise_level_db,
        sensitivity_db,
        load_resistance_ohm,
        efficiency,
        hydrophones,
    )
    return n * eta / (4 * resistance) * 10 ** ((rvs + sl - nl) / 10)


@formula(kappa_2_w=NOT_NEGATIVE, noise_level_db=REAL)
def kappa_3(kappa_2_w: ArrayLike, noise_level_db: ArrayLike) -> Array:
    """κ₃ = κ₂·10^(−NL/10), a ratio.

    Raises:
        InputError: a κ₂ is negative.
    """
    _, k2, nl = as_arrays(kappa_2_w, noise_level_db)
    return k2 * 10 ** (-nl / 10)


@formula(beta=_BETA, **_SLOT)
def g(beta: ArrayLike, slot_s: ArrayLike, packet_bits: ArrayLike, bandwidth_hz: ArrayLike) -> Array:
    """g(β) = log₁₀(β/(1−β)) − log₁₀(2^(L_t/((1−β)τB)) − 1), of the paper's appendix.

    Args:
        beta: β strictly between 0 and 1.
        slot_s: τ in s, above 0.
        packet_bits: L_t in bits, above 0.
        bandwidth_hz: B in Hz, above 0.

    Returns:
        g in the broadcast shape of the arguments; −inf where no number is as large as the SNR.

    Raises:
        InputError: an argument lies outside its range.
    """
    xp, b = as_arrays(beta)
    snr = required_snr.unchecked(packet_bits, (1 - b) * slot_s, bandwidth_hz)
    return xp.log10(b / (1 - b)) - xp.log10(snr)


@formula(beta=_BETA, **_SLOT)
def g_slope(
    beta: ArrayLike, slot_s: ArrayLike, packet_bits: ArrayLike, bandwidth_hz: ArrayLike
) -> Array:
    """∂g/∂β, with the second term's sign set right: the paper prints a plus.

    The 2^x − 1 under the second logarithm grows with β, so its term lowers the slope.
    With x = L_t/((1−β)τB) small, the slope is about 1/(β ln 10) and stays positive:
    the paper's conclusion, that g rises strictly, holds in the range it uses.

    Args and errors as for `g`.
    """
    xp, b = as_arrays(beta)
    exponent = math.log(2) * packet_bits / ((1 - b) * slot_s * bandwidth_hz)
    # x eˣ/(eˣ − 1), written so that no power overflows.
    relative = exponent / (1 - b) / -xp.expm1(-exponent)
    return (1 / (b * (1 - b)) - relative) / math.log(10)


@formula(attenuation_db=REAL, kappa_3=POSITIVE)
def h(attenuation_db: ArrayLike, kappa_3: ArrayLike) -> Array:
    """h(d) = AL(d)/5 − log₁₀ κ₃, of the paper's appendix; charging pays where g(β) ≥ h(d).

    Raises:
        InputError: a κ₃ is not above 0.
    """
    xp, al, k3 = as_arrays(attenuation_db, kappa_3)
    return al / 5 - xp.log10(k3)


@formula(g_value=REAL, kappa_3=POSITIVE)
def attenuation_at_balance_db(g_value: ArrayLike, kappa_3: ArrayLike) -> Array:
    """The attenuation at which g(β) = h(d): AL = 5 (g + log₁₀ κ₃), in dB.

    Raises:
        InputError: a κ₃ is not above 0.
    """
    xp, value, k3 = as_arrays(g_value, kappa_3)
    return 5 * (value + xp.log10(k3))


@formula(
    "the attenuation is reached nearer than 1 m",
    attenuation_db=REAL,
    absorption_db_per_km=NOT_NEGATIVE,
    spreading_db_per_decade=within(0, 40),
)
def attenuation_distance_m(
    attenuation_db: ArrayLike, absorption_db_per_km: ArrayLike, spreading_db_per_decade: ArrayLike
) -> Array:
    """The distance d ≥ 1 m up to which k log₁₀ d + α d is at most AL, by bisection on log d.

    Args:
        attenuation_db: AL in dB.
        absorption_db_per_km: α in dB/km, not negative.
        spreading_db_per_decade: k in dB per decade of distance, 0 to 40: k_s in the form of
            the paper's appendix, 10 k_s in its eq. `AL`.

    Returns:
        d in m, in the broadcast shape of the arguments; NaN where AL is reached nearer than
        1 m, where nothing spreads; inf where the loss never rises above AL, or farther away
        than any number of this type tells.

    Raises:
        InputError: an absorption is negative, or a spreading outside its range.
    """
    xp, al, alpha, spreading = as_arrays(
        attenuation_db, absorption_db_per_km, spreading_db_per_decade
    )
    at_one_metre = alpha / 1000
    # Either part alone brings the loss to AL: the distance is not beyond the nearer of the two.
    low = xp.zeros_like(al + alpha + spreading)
    infinite = low + math.inf
    one = xp.ones_like(low)
    farthest = math.floor(math.log10(float(xp.finfo(low.dtype).max)))
    spread = xp.where(spreading > 0, al / xp.where(spreading > 0, spreading, one), infinite)
    absorbed_m = xp.where(alpha > 0, al / xp.where(alpha > 0, at_one_metre, one), infinite)
    end = xp.minimum(spread, xp.log10(xp.where(absorbed_m > 1, absorbed_m, one)))
    high = xp.where(end < farthest, end, low + farthest)
    for _ in range(BISECTION_STEPS):
        middle = (low + high) / 2
        short = spreading * middle + at_one_metre * 10**middle < al
        low, high = xp.where(short, middle, low), xp.where(short, high, middle)
    distance_m = xp.where(end < farthest, 10**high, infinite)
    return xp.where(al < at_one_metre, low + math.nan, distance_m)
