"""What moving through water takes, against figures of an AUV and the definition of its optimum."""

import numpy as np
import pytest

from iout_marl import InputError
from iout_marl.physics import economical_speed_m_per_s, propulsion_power_w

#: Area, drag coefficient, efficiency; and the density of fresh water.
HULL, FRESH = (3.0, 0.006, 0.7), 1000.0


def test_figures_of_a_small_auv():
    speed = float(economical_speed_m_per_s(40.0, *HULL, FRESH))
    assert speed == pytest.approx(1.16, abs=0.005)
    per_metre = (40 + float(propulsion_power_w(speed, *HULL, FRESH))) / speed
    assert per_metre == pytest.approx(52, abs=0.5)
    assert 40 + float(propulsion_power_w(4.0, *HULL, FRESH)) == pytest.approx(863, abs=0.5)


def test_is_in_sea_water_unless_told_otherwise():
    ratio = propulsion_power_w(2.0, *HULL) / propulsion_power_w(2.0, *HULL, FRESH)
    assert float(ratio) == pytest.approx(1.025)


def test_no_other_speed_takes_less_for_a_metre():
    speeds = np.linspace(0.05, 5, 2000)
    per_metre = (40 + propulsion_power_w(speeds, *HULL)) / speeds
    best = float(economical_speed_m_per_s(40.0, *HULL))
    assert speeds[per_metre.argmin()] == pytest.approx(best, abs=0.01)
    # There half as much goes into moving as into everything else.
    assert float(propulsion_power_w(best, *HULL)) == pytest.approx(20)


@pytest.mark.parametrize("wrong", [(-1.0, *HULL), (1.0, 0.0, 0.1, 0.7), (1.0, 3.0, 0.1, 1.2)])
def test_refuses_what_lies_outside(wrong):
    with pytest.raises(InputError):
        propulsion_power_w(*wrong)
