"""Packets that bit errors destroy: by the signal-to-noise ratio of each bit."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

_erfc = np.vectorize(math.erfc, otypes=[np.float64])


def bpsk_bit_error_rate(eb_n0_db: npt.ArrayLike) -> Floats:
    """Share of bits that arrive wrong, P_b = ½ erfc √(E_b/N₀), of coherent binary phase shifts.

    J. G. Proakis, 'Digital Communications', in white Gaussian noise. NumPy alone has it: no array
    library of the standard need know erfc.

    Args:
        eb_n0_db: E_b/N₀, energy of a bit over the noise density, in dB, of any shape.

    Returns:
        from ½ down to 0, where no number is as small.
    """
    ratio = 10 ** (np.asarray(eb_n0_db, dtype=np.float64) / 10)
    return np.asarray(0.5 * _erfc(np.sqrt(ratio)))


def packet_error_rate(packet_bits: float, bit_error_rate: npt.ArrayLike) -> Floats:
    """Share of packets with a wrong bit, PER = 1 − (1 − P_b)^L = −expm1(L log1p(−P_b)).

    Bits fail independently of one another, and no code corrects them.

    Args:
        packet_bits: L, above 0.
        bit_error_rate: P_b, from 0 and below 1, of any shape.

    Returns:
        from 0 to 1; it is L P_b where that is small, to the last digits.
    """
    wrong = np.asarray(bit_error_rate, dtype=np.float64)
    return np.asarray(-np.expm1(packet_bits * np.log1p(-wrong)))
