"""What the cases on a GPU have in common: scenario, device, time, memory."""

from __future__ import annotations

import gc
import statistics
import subprocess
import time
from collections.abc import Callable, Iterator

import torch
from cases import Given, LeftOut, Row

from iout_marl.errors import InputError, is_lack_of_memory

SCENARIO = "paper/k10-fdd"
SLOTS = 100
REPEATS = 3
#: The first call is eager, the second captures, the third replays.
WARM = 3
SET_NETWORK = {"observation.kind": "table", "training.network": "set"}


def about(given: Given) -> Iterator[Row]:
    """The device."""
    if given.device == "cpu":
        yield {"name": "cpu", "torch": torch.__version__}
        return
    if not torch.cuda.is_available():
        yield {}
        return
    device = torch.cuda.get_device_properties(0)
    yield {
        "name": device.name,
        "driver": driver(),
        "CUDA": torch.version.cuda,
        "torch": torch.__version__,
        "capability": f"{device.major}.{device.minor}",
        "multiprocessors": device.multi_processor_count,
        "memory_mb": device.total_memory // 2**20,
    }


def driver() -> str | None:
    """Version of the driver, as its own tool tells it."""
    command = ["nvidia-smi", "--query-gpu=driver_version", "--format=csv,noheader"]
    try:
        found = subprocess.run(command, capture_output=True, text=True, check=True, timeout=20)
    except (OSError, subprocess.SubprocessError):
        return None
    return found.stdout.strip().partition("\n")[0]


def synchronise(device: str) -> None:
    """Wait for a device."""
    if device == "cuda":
        torch.cuda.synchronize()


def seconds(work: Callable[[], object], device: str, repeats: int = REPEATS) -> list[float]:
    """How long work takes, again and again."""
    found = []
    for _ in range(repeats):
        synchronise(device)
        started = time.perf_counter()
        work()
        synchronise(device)
        found.append(time.perf_counter() - started)
    return found


def rate(steps: int, took_s: list[float]) -> Row:
    """Steps a second."""
    rates = [steps / s for s in took_s]
    return {"steps/s": statistics.median(rates), "min": min(rates), "max": max(rates)}


def memory(device: str) -> Row:
    """Most memory that was held since the last `forget`."""
    return {"MB": torch.cuda.max_memory_reserved() / 1e6} if device == "cuda" else {}


def forget(device: str) -> None:
    """Give back the memory of what was measured before."""
    gc.collect()
    if device == "cuda":
        torch.cuda.init()
        torch.cuda.empty_cache()
        torch.cuda.reset_peak_memory_stats()


def while_it_fits(sizes: list[int], name: str, measure: Callable[[int], Row]) -> Iterator[Row]:
    """A row for each size, until one does not fit into memory."""
    for size in sizes:
        try:
            yield {name: size, **measure(size)}
        except (InputError, RuntimeError, MemoryError) as error:
            is_full = isinstance(error, torch.OutOfMemoryError) or is_lack_of_memory(error)
            if not is_full and "not enough memory" not in str(error):
                raise
            raise LeftOut(f"{size:,} {name} do not fit into memory") from None


def powers(first: int, last: int) -> list[int]:
    """Powers of four, from one to another."""
    return [4**i for i in range(13) if first <= 4**i <= last]
