"""Bit errors and the packets that they destroy, against other ways to get there."""

import math

import numpy as np
import pytest

from iout_marl.physics.packets import bpsk_bit_error_rate, packet_error_rate


def test_bit_errors_are_those_of_drawn_symbols():
    """Antipodal symbols in white noise, decided by their sign."""
    rng, bits = np.random.default_rng(0), 400_000
    for eb_n0_db in (-3.0, 0.0, 4.0):
        ratio = 10 ** (eb_n0_db / 10)
        wrong = np.mean(math.sqrt(2 * ratio) + rng.standard_normal(bits) < 0)
        expected = float(bpsk_bit_error_rate(eb_n0_db))
        assert abs(wrong - expected) < 4 * math.sqrt(expected * (1 - expected) / bits)


@pytest.mark.parametrize(("eb_n0_db", "packet_bits"), [(4.0, 64), (6.0, 256), (7.0, 1000)])
def test_packet_errors_are_those_of_packets_bit_by_bit(eb_n0_db, packet_bits):
    rng, packets = np.random.default_rng(1), 4000
    amplitude = math.sqrt(2 * 10 ** (eb_n0_db / 10))
    lost = 0
    for _ in range(packets):
        lost += bool((amplitude + rng.standard_normal(packet_bits) < 0).any())
    expected = float(packet_error_rate(packet_bits, bpsk_bit_error_rate(eb_n0_db)))
    margin = 4 * math.sqrt(expected * (1 - expected) / packets)
    assert 0.02 < expected < 0.98
    assert abs(lost / packets - expected) < margin


@pytest.mark.parametrize("packet_bits", [1, 100, 2048, 1e6, 1e9])
@pytest.mark.parametrize("eb_n0_db", [-40, -10, 0, 3, 8, 12, 14, 17])
def test_extremes_keep_their_digits(eb_n0_db, packet_bits):
    mpmath = pytest.importorskip("mpmath")
    with mpmath.workdps(60):
        ratio = mpmath.mpf(10) ** (mpmath.mpf(eb_n0_db) / 10)
        wrong = mpmath.erfc(mpmath.sqrt(ratio)) / 2
        lost = 1 - (1 - wrong) ** mpmath.mpf(packet_bits)
        found_wrong = float(bpsk_bit_error_rate(float(eb_n0_db)))
        found = float(packet_error_rate(packet_bits, found_wrong))
        assert found_wrong == pytest.approx(float(wrong), rel=1e-12)
        assert found == pytest.approx(float(lost), rel=1e-11)


def test_ends_are_certain():
    assert packet_error_rate(2048, bpsk_bit_error_rate([-300.0, 60.0])).tolist() == [1.0, 0.0]
    assert bpsk_bit_error_rate(np.full((2, 3), 5.0)).shape == (2, 3)
