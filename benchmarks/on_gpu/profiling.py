"""What an iteration consists of: kernels, gaps, waits of the host."""

from __future__ import annotations

import json
import statistics
import tempfile
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import torch
from cases import Case, Given, LeftOut, Row

from iout_marl.scenario import load_scenario
from on_gpu.measuring import SCENARIO, WARM, seconds
from trainers import Trainer

#: Categories of a trace that the device works on.
ON_DEVICE = ("kernel", "gpu_memcpy", "gpu_memset")
OF_DRIVER = ("cuda_runtime", "cuda_driver")


def profile(changes: dict[str, Any], *, use_graphs: bool) -> Case:
    """An iteration, as the profiler sees it."""

    def measure(given: Given) -> Iterator[Row]:
        if given.device == "cpu":
            raise LeftOut("a CPU has no kernels; learning_step.py profiles its operations")
        scenario = load_scenario(SCENARIO, changes)
        trainer = Trainer(scenario, device=given.device, use_graphs=use_graphs)
        for _ in range(WARM):
            trainer.iterate_all()
        ms = [1e3 * s for s in seconds(trainer.iterate_all, given.device, 5)]
        yield {"figure": "iteration without the profiler, ms", "value": statistics.median(ms)}
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "trace.json"
            for _ in range(2):  # the first starts the profiler
                with torch.profiler.profile() as profiler:
                    trainer.iterate_all()
                    torch.cuda.synchronize()
            profiler.export_chrome_trace(str(path))
            events = json.loads(path.read_text(encoding="utf-8"))["traceEvents"]
        yield from figures_of(events)

    return measure


def figures_of(events: Iterable[Row], most: int = 20) -> Iterator[Row]:
    """What the events of a trace come to: times there are in µs.

    Args:
        events: of the `traceEvents` of a trace.
        most: how many kernels to name.
    """
    whole = [e for e in events if e.get("ph") == "X" and "cat" in e]
    work = sorted((e for e in whole if e["cat"] in ON_DEVICE), key=lambda e: e["ts"])
    calls = [e for e in whole if e["cat"] in OF_DRIVER]
    if not work:
        raise LeftOut("the profiler has seen no kernel")
    gaps, end = [], work[0]["ts"]
    for event in work:
        gaps.append(max(event["ts"] - end, 0))
        end = max(end, event["ts"] + event["dur"])
    span = end - work[0]["ts"]
    waits = [e for e in calls if "Synchronize" in e["name"]]
    figures: dict[str, float] = {
        "kernels, copies and fills": len(work),
        "time of all of them, ms": sum(e["dur"] for e in work) / 1e3,
        "from the first to the end of the last, ms": span / 1e3,
        "gaps in between, ms": sum(gaps) / 1e3,
        "gaps of more than 10 µs": sum(gap > 10 for gap in gaps),
        "longest gap, µs": max(gaps),
        "launches of kernels": sum("LaunchKernel" in e["name"] for e in calls),
        "launches of graphs": sum("GraphLaunch" in e["name"] for e in calls),
        "waits of the host (one is the profile's)": len(waits),
        "waits of the host, ms": sum(e["dur"] for e in waits) / 1e3,
        "copies to the host": sum("DtoH" in e["name"] for e in work),
        "copies to the device": sum("HtoD" in e["name"] for e in work),
    }
    yield from ({"figure": name, "value": value} for name, value in figures.items())
    times: dict[str, list[float]] = defaultdict(list)
    for event in work:
        times[event["name"]].append(event["dur"])
    total = sum(sum(each) for each in times.values())
    for name, each in sorted(times.items(), key=lambda item: -sum(item[1]))[:most]:
        yield {
            "ms": sum(each) / 1e3,
            "share": sum(each) / total,
            "calls": len(each),
            "kernel": name,
        }
