"""Results as a report takes them: their texts are data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from iout_marl.evaluation import METRICS
from iout_marl.report.markup import as_data
from iout_marl.study.results import Record, Results


class _Texts:
    """Texts as data. Different ones stay different: names tell series and worlds apart."""

    def __init__(self) -> None:
        self._made: dict[str, str] = {}
        self._used: set[str] = set()

    def __call__(self, text: str) -> str:
        if text not in self._made:
            made, number = as_data(text), 2
            while made in self._used:
                made, number = f"{as_data(text)} ({number})", number + 1
            self._made[text] = made
            self._used.add(made)
        return self._made[text]

    def name(self, text: str) -> str:
        """The same of a name, which cannot be blank."""
        return self(text if text.strip() else "(no name)")


def take_in(results: Results) -> Results:
    """The results that a report shows: their texts are data (see `markup.as_data`)."""
    data = _Texts()
    cells = [
        cell.model_copy(
            update={
                "series": data.name(cell.series),
                "group": data(cell.group),
                "record": _record(cell.record, data),
            }
        )
        for cell in results.cells
    ]
    failures = [
        failure.model_copy(
            update={"series": data.name(failure.series), "error": data(failure.error)}
        )
        for failure in results.failures
    ]
    axis = {
        "key": data(results.axis.key),
        "label": data(results.axis.label),
        "variants": tuple(map(data, results.axis.variants)),
    }
    return results.model_copy(
        update={
            **{
                name: as_data(getattr(results, name))
                for name in ("title", "description", "command")
            },
            "axis": results.axis.model_copy(update=axis),
            "cells": tuple(cells),
            "failures": tuple(failures),
        }
    )


def _record(record: Record, data: _Texts) -> Record:
    texts = ("scenario", "scenario_hash", "world_hash", "search", "date")
    changes = {name: data(getattr(record, name)) for name in texts if getattr(record, name)}
    samples = {
        name if name in METRICS else data.name(name): values
        for name, values in record.samples.items()
    }
    machine = {as_data(name): as_data(value) for name, value in record.machine.items()}
    return record.model_copy(update={**changes, "samples": samples, "machine": machine})


def curves(
    records: Sequence[Record], curve: str
) -> tuple[list[float], np.ndarray[tuple[int, int], np.dtype[np.float64]]]:
    """Environment steps, and the curve of every training among the records, (seeds, steps).

    They end with the shortest; trainings without that curve are left out.
    """
    found = [
        (training.curve["env_steps"], training.curve[curve])
        for training in (record.training for record in records)
        if training and training.curve.get("env_steps") and training.curve.get(curve)
    ]
    shortest = min((min(len(steps), len(values)) for steps, values in found), default=0)
    steps = found[0][0][:shortest] if found else []
    return steps, np.array([values[:shortest] for _, values in found], dtype=np.float64)
