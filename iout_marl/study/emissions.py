"""Energy and CO₂ of a training, by codecarbon where it is installed (extra `emissions`)."""

from __future__ import annotations

import functools
import logging
import threading
from collections.abc import Callable
from typing import Any, TypeVar

from iout_marl.extras import missing
from iout_marl.study.records import Emissions

Result = TypeVar("Result")

#: One measurement at a time: codecarbon measures the process, not a thread.
_measuring = threading.Lock()


def measured(
    function: Callable[[], Result], carbon_g_per_kwh: float
) -> tuple[Result, Emissions | None]:
    """Call a function and measure what it takes.

    Args:
        function: what to call.
        carbon_g_per_kwh: carbon intensity of the electricity.

    Returns:
        what the function returns, and the emissions: None where codecarbon is not
        installed, or where another thread of the process is being measured.
    """
    tracker = _tracker(carbon_g_per_kwh)
    if tracker is None or not _measuring.acquire(blocking=False):
        return function(), None
    try:
        tracker.start_task()
        try:
            result = function()
        finally:
            data = tracker.stop_task()
    finally:
        _measuring.release()
    if not data.energy_consumed > 0:  # the processor's counters stood still
        return result, None
    return result, Emissions(
        energy_kwh=float(f"{data.energy_consumed:.4g}"),
        co2_kg=float(f"{data.emissions:.4g}"),
        codecarbon=data.codecarbon_version,
    )


@functools.cache
def _tracker(carbon_g_per_kwh: float) -> Any:
    """The tracker of this process; finding out about the hardware takes it seconds."""
    if missing("emissions"):
        return None
    logging.getLogger("codecarbon").disabled = True  # it tells of every estimate it makes
    from codecarbon import OfflineEmissionsTracker

    return OfflineEmissionsTracker(
        country_iso_code="USA",  # asked for, but of no effect beside the carbon intensity
        force_carbon_intensity_g_co2e_kwh=carbon_g_per_kwh,
        tracking_mode="process",
        allow_multiple_runs=True,
        output_methods=[],
        log_level="critical",
    )
