"""In place of codecarbon, which takes seconds of every process to load and look at the hardware.

`tests/study/test_emissions.py` measures by the real one.
"""

import time
from types import SimpleNamespace

WATTS = 20.0


class OfflineEmissionsTracker:
    """Takes the processor's time at a constant power."""

    def __init__(self, *, force_carbon_intensity_g_co2e_kwh, **_):
        self._g_per_kwh = force_carbon_intensity_g_co2e_kwh

    def start_task(self):
        self._begun_s = time.process_time()

    def stop_task(self):
        kwh = WATTS * (time.process_time() - self._begun_s) / 3.6e6
        return SimpleNamespace(
            energy_consumed=kwh,
            emissions=kwh * self._g_per_kwh / 1000,
            codecarbon_version="a stub",
        )
