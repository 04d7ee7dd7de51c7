"""What a training takes, measured where codecarbon is installed."""

import importlib
import sys
import time
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace

import pytest

from iout_marl.study import emissions

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", autouse=True)
def _real_codecarbon():
    """All other tests have a stub of it."""
    paths, stub = list(sys.path), sys.modules.pop("codecarbon", None)
    sys.path[:] = [path for path in paths if Path(path).name != "stubs"]
    importlib.invalidate_caches()
    yield
    sys.path[:] = paths
    for name in [name for name in sys.modules if name.partition(".")[0] == "codecarbon"]:
        del sys.modules[name]
    if stub is not None:
        sys.modules["codecarbon"] = stub


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
    assert found.codecarbon == version("codecarbon")


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


def test_counters_that_stand_still_are_no_measurement(monkeypatch):
    idle = SimpleNamespace(energy_consumed=0.0)
    tracker = SimpleNamespace(start_task=lambda: None, stop_task=lambda: idle)
    monkeypatch.setattr(emissions, "_tracker", lambda _: tracker)
    assert emissions.measured(work, 571.0) == ("done", None)
