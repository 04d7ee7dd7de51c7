"""Results as a report takes them: texts that are data, and cells that have something to show."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

from iout_marl.evaluation import METRICS
from iout_marl.report.markup import as_data
from iout_marl.study.results import CellResult, Failure, Record, Results


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
    """The results that a report shows.

    Texts become data (see `markup.as_data`). A cell without an episode, or at no number on the
    axis, becomes a failure; bounds among policies of one series become a series of their own.
    """
    data = _Texts()
    policies = {cell.series for cell in results.cells if not cell.record.is_bound}
    cells, failures = [], []
    for cell in results.cells:
        mixed = cell.record.is_bound and cell.series in policies
        series = data.name(f"{cell.series} (bound)" if mixed else cell.series)
        fault = _fault(cell)
        if fault is None:
            changes = {"series": series, "group": data(cell.group)}
            cells.append(cell.model_copy(update={**changes, "record": _record(cell.record, data)}))
        else:
            failures.append(
                Failure(series=series, axis=cell.axis, seed=cell.record.seed, error=fault)
            )
    failures += [
        failure.model_copy(
            update={"series": data.name(failure.series), "error": data(failure.error)}
        )
        for failure in results.failures
    ]
    axis = {"key": data(results.axis.key), "label": data(results.axis.label)}
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


def _fault(cell: CellResult) -> str | None:
    if not math.isfinite(cell.axis):
        return "its place on the axis is no number"
    return None if cell.record.episodes > 0 else "its record has no episode"


def _record(record: Record, data: _Texts) -> Record:
    texts = ("scenario", "scenario_hash", "world_hash", "search", "date")
    changes = {name: data(getattr(record, name)) for name in texts if getattr(record, name)}
    samples = {
        name if name in METRICS else data.name(name): values
        for name, values in record.samples.items()
    }
    machine = {as_data(name): as_data(value) for name, value in record.machine.items()}
    return record.model_copy(update={**changes, "samples": samples, "machine": machine})


class Walk(BaseModel):
    """The episode of a record, as `iout_marl.episode.Episode` has it."""

    model_config = ConfigDict(frozen=True, strict=False)

    grid: tuple[int, int, int]
    spacing_m: float
    nodes: tuple[tuple[int, int, int], ...]
    path: tuple[tuple[tuple[int, int, int], ...], ...]
    charged: tuple[tuple[int, ...], ...]
    heard: tuple[tuple[int, ...], ...]
    delivered: tuple[tuple[bool, ...], ...]
    ages: tuple[tuple[int, ...], ...]

    @property
    def is_whole(self) -> bool:
        """Whether its parts are of one length, and its cells and nodes are there."""
        slots, auvs = len(self.charged), len(self.path[0]) if self.path else 0
        of_auvs = (*self.path, *self.charged, *self.heard, *self.delivered)
        of_slots = (self.path[1:], self.heard, self.delivered, self.ages)
        cells = [*self.nodes, *(cell for slot in self.path for cell in slot)]
        chosen = [node for part in (self.charged, self.heard) for slot in part for node in slot]
        return (
            auvs > 0
            and min(self.grid) > 0
            and math.isfinite(self.spacing_m)
            and all(len(part) == slots for part in of_slots)
            and all(len(slot) == auvs for slot in of_auvs)
            and all(len(slot) == len(self.nodes) for slot in self.ages)
            and all(1 <= c <= n for cell in cells for c, n in zip(cell, self.grid, strict=True))
            and all(0 <= node <= len(self.nodes) for node in chosen)
        )


def walk_of(record: Record) -> Walk | None:
    """The episode of a record; None where it has none, or none that can be shown."""
    try:
        walk = Walk.model_validate(record.episode)
    except ValidationError:
        return None
    return walk if walk.is_whole else None


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
