"""What a training takes, measured where codecarbon is installed."""

import sys
import time

import pytest

from iout_marl.study import emissions


@pytest.fixture(autouse=True)
def _no_tracker_kept():
    emissions._tracker.cache_clear()
    yield
    emissions._tracker.cache_clear()


def work():
    end = time.process_time() + 0.3
    while time.process_time() < end:
        sum(range(1000))
    return "done"


def test_energy_is_measured_and_carbon_follows_from_it():
    result, found = emissions.measured(work, 571.0)
    assert result == "done"
    assert found.energy_kwh > 0
    assert found.co2_kg == pytest.approx(0.571 * found.energy_kwh, rel=0.01)
    assert found.codecarbon


def test_every_measurement_counts_only_its_own():
    first = emissions.measured(work, 571.0)[1]
    idle = emissions.measured(lambda: None, 571.0)[1]
    assert idle.energy_kwh < 0.5 * first.energy_kwh


def test_without_codecarbon_nothing_is_measured(monkeypatch):
    monkeypatch.setitem(sys.modules, "codecarbon", None)
    assert emissions.measured(work, 571.0) == ("done", None)


def test_a_second_measurement_in_the_same_process_is_left_out():
    _, (inner, found) = _swap(emissions.measured(lambda: emissions.measured(work, 571.0), 571.0))
    assert inner == "done"
    assert found is None


def _swap(pair):
    return pair[1], pair[0]


def test_a_failing_function_ends_its_measurement():
    with pytest.raises(ZeroDivisionError):
        emissions.measured(lambda: 1 / 0, 571.0)
    assert emissions.measured(work, 571.0)[1] is not None
