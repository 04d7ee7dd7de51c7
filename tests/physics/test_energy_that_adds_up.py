"""Harvest of an aperture and packets of a modem, against figures worked out by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iout_marl import physics

#: A source of 2 kW electric, half of which becomes sound, and a beam of 20 dB: SL 220.8 dB.
ACOUSTIC_W = 1000.0
#: Thorp's absorption at 40 kHz in dB/km, added up by hand.
ABSORPTION = 12.904
levels = st.floats(0, 260)
areas = st.floats(1e-4, 10)


def received_db(distance_m):
    source = physics.source_level_db(2000, 0.5, 20)
    return source - physics.transmission_loss_db(distance_m, ABSORPTION, 2)


@pytest.mark.parametrize(
    ("distance_m", "harvested_w"), [(10, 0.76), (50, 27e-3), (100, 5.8e-3), (200, 1.1e-3)]
)
def test_harvest_of_a_receiver_of_200_cm2(distance_m, harvested_w):
    """20 log₁₀ d + α d off 220.8 dB, 6.504e-19 W/m² at 0 dB, 0.02 m², half of it stored."""
    found = physics.aperture_power_w(received_db(distance_m), 0.02, ACOUSTIC_W, 0.5)
    assert found == pytest.approx(harvested_w, rel=0.03)


def test_intensity_of_one_micropascal():
    assert physics.intensity_w_per_m2(0) == pytest.approx(6.504e-19, rel=1e-4)


def test_all_that_a_source_emits_passes_a_sphere_around_it():
    """170.8 dB at 1 m are 1 W through 4π m², to the digits of that level."""
    through = 4 * np.pi * physics.intensity_w_per_m2(physics.REFERENCE_LEVEL_DB)
    assert through == pytest.approx(1, rel=0.02)


@given(level_db=levels, area_m2=areas, efficiency=st.floats(0.01, 1), threshold_w=st.floats(0, 10))
def test_no_more_is_harvested_than_arrives_or_is_emitted(
    level_db, area_m2, efficiency, threshold_w
):
    found = physics.aperture_power_w(level_db, area_m2, ACOUSTIC_W, efficiency, threshold_w)
    incident = min(physics.intensity_w_per_m2(level_db) * area_m2, ACOUSTIC_W)
    assert found == pytest.approx(efficiency * incident if incident >= threshold_w else 0)
    assert found <= efficiency * ACOUSTIC_W


def test_nothing_is_harvested_below_the_threshold():
    # I·A of 100 m is 2 · 5.8 mW.
    around = [
        physics.aperture_power_w(received_db(100), 0.02, ACOUSTIC_W, 0.5, w) for w in (11e-3, 12e-3)
    ]
    assert around[0] == pytest.approx(5.8e-3, rel=0.01)
    assert around[1] == 0


@pytest.mark.parametrize(
    ("distance_m", "energy_j"),
    # 0.4096 s of 1 W, and the sound: SL = 40 + 20 log₁₀ d + α d + 10 over 170.8 dB, half electric.
    [(0, 0.4096), (1000, 0.4096 * (1 + 2 * 10 ** ((40 + 60 + 12.904 + 10 - 170.8) / 10)))],
)
def test_a_packet_of_256_bytes_at_5_kbps(distance_m, energy_j):
    loss_db = physics.transmission_loss_db(distance_m, ABSORPTION, 2)
    power_w = physics.sonar_transmit_power_w(10, loss_db, 40, 0.5)
    assert physics.airtime_s(2048, 5000) == pytest.approx(0.4096)
    assert physics.modem_energy_j(power_w, 1, 2048, 5000) == pytest.approx(energy_j, rel=1e-4)


def test_loud_packets_take_half_a_joule():
    """At 165 dB, 0.26 W of sound and 0.53 W electric: the figure of real modems, 0.4 to 0.7 J."""
    power_w = physics.electrical_power_w(165, 0.5)
    assert power_w == pytest.approx(0.526, rel=1e-2)
    assert physics.modem_energy_j(power_w, 1, 2048, 5000) == pytest.approx(0.625, rel=1e-2)


def test_call_and_answer_over_a_kilometre():
    assert physics.round_trip_s(1000) == pytest.approx(4 / 3)
