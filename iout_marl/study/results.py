"""What cells have computed: kept as JSON, read back, put together into intervals."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

from pydantic import BaseModel, Field, ValidationError, model_validator

from iout_marl.errors import InputError
from iout_marl.evaluation import METRICS, Estimate
from iout_marl.files import read_json, to_json
from iout_marl.metrics import described
from iout_marl.scenario.fields import invalid
from iout_marl.scenario.layers import show_path
from iout_marl.study.cells import MAX_CELLS
from iout_marl.study.fields import Line, NotNegative, Number, Text, Words
from iout_marl.study.records import (
    DIGITS,
    Emissions,
    Record,
    Saved,
    TrainingRecord,
)
from iout_marl.study.schema import Axis, Report, Seed, Study
from iout_marl.world import WORLD_VERSION

#: Also of the records within.
__all__ = [
    "FORMAT",
    "CellResult",
    "Emissions",
    "Failure",
    "Measured",
    "Record",
    "Results",
    "TrainingRecord",
    "check_version",
    "measured_of",
    "read_record",
    "read_results",
    "record_to_json",
    "validated",
]

#: Changes whenever older files can no longer be read.
FORMAT = 1
_VERSIONS = ("format", "world_version")
Model = TypeVar("Model", bound=BaseModel)


class CellResult(Saved):
    """A record, and where the report shows it."""

    group: Words
    series: Words
    axis: Number
    record: Record


class Failure(Saved):
    """A cell that failed."""

    series: Words
    axis: Number
    seed: Seed
    error: Words


@dataclass(frozen=True)
class Measured:
    """An estimate, and what its interval is of.

    Attributes:
        samples: the values behind it: the means of the seeds, or the episodes.
        over: `seeds`, or `episodes` where there is only one seed.
        bounds: what the values cannot be below and above, where their intervals end.
    """

    samples: tuple[float, ...]
    over: str
    bounds: tuple[float, float] = (0.0, math.inf)

    @property
    def estimate(self) -> Estimate:
        """Mean and 95 % interval (Student's t), which ends at the bounds."""
        found = Estimate.from_samples(self.samples)
        low, high = self.bounds
        if math.isnan(found.low):
            return found
        return Estimate(found.mean, max(found.low, low), min(found.high, high))

    @property
    def mean(self) -> float:
        """The mean."""
        return self.estimate.mean


def measured_of(records: Iterable[Record], metric: str) -> Measured | None:
    """A metric of the records of one place; None where it was not measured."""
    found = [record for record in records if metric in record.samples]
    if not found:
        return None
    bounds = described(metric).low, described(metric).high
    if len(found) > 1:
        return Measured(tuple(record.mean(metric) for record in found), "seeds", bounds)
    return Measured(tuple(found[0].samples[metric]), "episodes", bounds)


class Results(Saved):
    """The results of a study."""

    format: int = FORMAT
    world_version: int = WORLD_VERSION
    name: Words
    title: Words
    description: Text
    report: Report
    axis: Axis
    front: bool = False
    carbon_g_per_kwh: NotNegative
    quick: bool
    command: Line
    cells: Annotated[tuple[CellResult, ...], Field(max_length=MAX_CELLS, strict=False)]
    failures: Annotated[tuple[Failure, ...], Field(max_length=MAX_CELLS, strict=False)] = ()

    @classmethod
    def from_records(
        cls,
        name: str,
        study: Study,
        cells: Iterable[CellResult],
        failures: Iterable[Failure],
        command: str,
        *,
        quick: bool,
    ) -> Self:
        """The results of a study."""
        return cls(
            name=name,
            title=study.title,
            description=study.description,
            report=study.report,
            axis=study.axis,
            front=study.front,
            carbon_g_per_kwh=study.carbon_g_per_kwh,
            quick=quick,
            command=command,
            cells=tuple(cells),
            failures=tuple(failures),
        )

    @model_validator(mode="after")
    def _tells_bounds_from_policies(self) -> Self:
        bounds = {cell.series for cell in self.cells if cell.record.is_bound}
        for i, cell in enumerate(self.cells):
            if cell.series in bounds and not cell.record.is_bound:
                raise invalid(("cells", i, "series"), "is a series of bounds and of policies")
        return self

    @property
    def series(self) -> list[str]:
        """Names of the series, in the study's order."""
        return list(dict.fromkeys(cell.series for cell in self.cells))

    @property
    def metrics(self) -> tuple[str, ...]:
        """Names of the metrics of all cells: the built-in ones, then users', as they come."""
        found = (name for cell in self.cells for name in cell.record.samples)
        return tuple(dict.fromkeys((*METRICS, *found)))

    def is_bound(self, series: str) -> bool:
        """Whether a series is one of bounds, not of policies."""
        return any(record.is_bound for record in self.records(series))

    def group_series(self, group: str) -> list[str]:
        """Names of the series of one group."""
        return list(dict.fromkeys(cell.series for cell in self.cells if cell.group == group))

    def places(self, series: str | None = None) -> list[float]:
        """Places on the axis, ascending, of one series or of all."""
        return sorted({c.axis for c in self.cells if series is None or c.series == series})

    def place_text(self, place: float) -> str:
        """A place on the axis in words."""
        return self.axis.text(place)

    def records(self, series: str, place: float | None = None) -> list[Record]:
        """Records of a series, at one place on the axis or at all."""
        return [
            cell.record
            for cell in self.cells
            if cell.series == series and (place is None or cell.axis == place)
        ]

    def measured(self, series: str, place: float, metric: str) -> Measured | None:
        """A metric of a series at a place; None where nothing was measured."""
        return measured_of(self.records(series, place), metric)

    def to_json(self) -> str:
        """As the text of a file."""
        return to_json(self.model_dump(mode="json")) + "\n"

    def to_csv(self) -> str:
        """A row for every cell: means of its metrics, seconds and emissions."""
        text = io.StringIO()
        rows = csv.writer(text, lineterminator="\n")
        place = ("group", "series", self.axis.name, "scenario", "scenario_hash", "policy", "seed")
        cost = ("env_steps", "seconds", "energy_kwh", "co2_kg", "search")
        metrics = self.metrics
        place_of = self.place_text if self.axis.variants else "{:g}".format
        rows.writerow((*place, "episodes", *metrics, *cost))
        for cell in self.cells:
            record = cell.record
            training = record.training
            emissions = training.emissions if training else None
            rows.writerow(
                (
                    *(cell.group, cell.series, place_of(cell.axis), record.scenario),
                    *(record.scenario_hash, record.policy, record.seed, record.episodes),
                    *(
                        f"{record.mean(metric):.{DIGITS}g}" if metric in record.samples else ""
                        for metric in metrics
                    ),
                    *((training.env_steps, training.seconds) if training else ("", "")),
                    *((emissions.energy_kwh, emissions.co2_kg) if emissions else ("", "")),
                    record.search,
                )
            )
        return text.getvalue()


def read_results(path: Path) -> Results:
    """Read a file of results.

    Raises:
        InputError: it cannot be read, is damaged, or of another version.
    """
    data = read_json(path)
    check_version(path, data)
    return validated(Results, path, data)


def read_record(path: Path, key: str) -> Record:
    """Read a file of the cell of this key.

    Raises:
        InputError: as `read_results`, or it is the file of another cell.
    """
    data = read_json(path)
    check_version(path, data)
    record = validated(Record, path, data.get("record"))
    if record.key != key:
        raise InputError(f"{path}: cannot be read: it is of the cell {record.key}")
    return record


def record_to_json(record: Record) -> str:
    """A cell's record as the text of a file, with the versions that it is of."""
    data = {"format": FORMAT, "world_version": WORLD_VERSION, "record": record.model_dump()}
    return to_json(data) + "\n"


def check_version(path: Path, data: Any) -> None:
    """Refuse what another version of this software has written.

    Raises:
        InputError: it has, or it says nothing of versions.
    """
    found = [data.get(key) if isinstance(data, dict) else None for key in _VERSIONS]
    if not all(type(version) is int for version in found):
        raise InputError(
            f"{path}: cannot be read: it is no file of a study, or damaged: the numbers "
            f"{' and '.join(_VERSIONS)} are missing"
        )
    if found != [FORMAT, WORLD_VERSION]:
        raise InputError(
            f"{path}: is of another version of this software: format {found[0]} and world "
            f"version {found[1]}, not {FORMAT} and {WORLD_VERSION}"
        )


def validated(model: type[Model], path: Path, data: Any) -> Model:
    """What a file says, as a checked model.

    Raises:
        InputError: it is damaged: one line with the file, the place in it and what is wrong.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        problem = error.errors(include_url=False, include_input=False)[0]
        loc = (*problem["loc"], *problem.get("ctx", {}).get("path", ()))
        where = show_path(tuple(k if isinstance(k, int) else k[:40] for k in loc)) or "all of it"
        message = problem["msg"].replace("Input should", "must")
        raise InputError(f"{path}: cannot be read: {where}: {message}") from None
