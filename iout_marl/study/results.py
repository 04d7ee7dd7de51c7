"""What cells have computed: kept as JSON, read back, put together into intervals."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

from iout_marl import machine
from iout_marl.errors import InputError
from iout_marl.evaluation import METRICS, Estimate
from iout_marl.files import read_json, to_json
from iout_marl.study.cells import Cell
from iout_marl.study.schema import BOUND, Axis, Study
from iout_marl.world import WORLD_VERSION, pin_layout

#: Changes whenever older files can no longer be read.
FORMAT = 1
#: Digits that are kept of a figure.
DIGITS = 7

#: What metrics cannot be below and above: where intervals end.
BOUNDS = {
    "jain": (0.0, 1.0),
    "jain_violation": (0.0, 1.0),
    "uplink_success": (0.0, 1.0),
    "reward": (-math.inf, math.inf),
}
NOT_NEGATIVE = (0.0, math.inf)

Model = TypeVar("Model", bound=BaseModel)


class Emissions(BaseModel):
    """What a training took, by codecarbon."""

    model_config = ConfigDict(frozen=True)

    energy_kwh: float
    co2_kg: float
    codecarbon: str  # its version


class TrainingRecord(BaseModel):
    """A training: by which settings, how long it took, and how it went.

    `curve` has a list for each of `env_steps`, `aoi/mean`, `fairness/jain`,
    `energy/harvested_kj` and `reward/total`, of the episodes of each rollout.
    """

    model_config = ConfigDict(frozen=True)

    settings: dict[str, Any]
    env_steps: int
    seconds: float
    curve: dict[str, list[float]]
    emissions: Emissions | None


class Record(BaseModel):
    """What a cell has computed.

    `samples` has every metric of every episode, of a bound the one that it bounds; `episode`
    the first episode in full, of policies that were trained (see `iout_marl.episode.Episode`).
    `world_hash` is that of the world that was played: of one layout, where one was drawn.
    `search` says how a bound was found, or how long a plan was searched for.
    """

    model_config = ConfigDict(frozen=True)

    key: str
    scenario: str
    scenario_hash: str
    world_hash: str
    duplex: str
    nodes: int
    auvs: int
    maximum_age: float
    minimum_jain: float
    policy: str
    seed: int
    episodes: int
    samples: dict[str, list[float]]
    training: TrainingRecord | None
    episode: dict[str, Any] | None
    machine: dict[str, str]
    date: str
    search: str = ""

    @classmethod
    def of(
        cls,
        cell: Cell,
        samples: dict[str, Any],
        date: str,
        training: TrainingRecord | None = None,
        episode: dict[str, Any] | None = None,
        search: str = "",
    ) -> Self:
        """The record of a cell on this machine."""
        scenario = cell.scenario
        return cls(
            key=cell.key,
            scenario=scenario.name,
            scenario_hash=scenario.hash,
            world_hash=pin_layout(scenario, cell.seed).world_hash,
            duplex=scenario.duplex.kind,
            nodes=scenario.num_nodes,
            auvs=scenario.num_auvs,
            maximum_age=scenario.age.maximum,
            minimum_jain=scenario.fairness.minimum_jain,
            policy=cell.policy,
            seed=cell.seed,
            episodes=cell.episodes,
            samples={name: rounded(samples[name]) for name in metrics_of(cell.policy)},
            training=training,
            episode=episode,
            machine=machine.describe(),
            date=date,
            search=search,
        )

    @model_validator(mode="after")
    def _has_every_sample(self) -> Self:
        for name in metrics_of(self.policy):
            values = self.samples.get(name, [])
            if len(values) != self.episodes or not np.isfinite(values).all():
                raise ValueError(f"samples.{name} must hold a number for each episode")
        return self

    @property
    def is_bound(self) -> bool:
        """Whether it is no policy's, but what none can beat."""
        return self.policy == BOUND

    def mean(self, metric: str) -> float:
        """A metric's mean over the episodes."""
        return float(np.mean(self.samples[metric]))


def metrics_of(policy: str) -> tuple[str, ...]:
    """What is known of a policy, or of a bound."""
    return ("mean_aoi",) if policy == BOUND else METRICS


def rounded(values: Iterable[float]) -> list[float]:
    """Plain numbers of `DIGITS` digits."""
    return [float(f"{value:.{DIGITS}g}") for value in values]


class CellResult(BaseModel):
    """A record, and where the report shows it."""

    model_config = ConfigDict(frozen=True)

    group: str
    series: str
    axis: float
    record: Record


class Failure(BaseModel):
    """A cell that failed."""

    model_config = ConfigDict(frozen=True)

    series: str
    axis: float
    seed: int
    error: str


@dataclass(frozen=True)
class Measured:
    """An estimate, and what its interval is of.

    Attributes:
        samples: the values behind it: the means of the seeds, or the episodes.
        over: `seeds`, or `episodes` where there is only one seed.
        bounds: what the values cannot be below and above.
    """

    samples: tuple[float, ...]
    over: str
    bounds: tuple[float, float] = NOT_NEGATIVE

    @property
    def estimate(self) -> Estimate:
        """Mean and 95 % interval (Student's t), which ends at the bounds."""
        found = Estimate.of(self.samples)
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
    bounds = BOUNDS.get(metric, NOT_NEGATIVE)
    if len(found) > 1:
        return Measured(tuple(record.mean(metric) for record in found), "seeds", bounds)
    return Measured(tuple(found[0].samples[metric]), "episodes", bounds)


class Results(BaseModel):
    """The results of a study."""

    model_config = ConfigDict(frozen=True)

    format: int = FORMAT
    world_version: int = WORLD_VERSION
    name: str
    title: str
    description: str
    report: str
    axis: Axis
    front: bool = False
    carbon_g_per_kwh: float
    quick: bool
    command: str
    cells: tuple[CellResult, ...]
    failures: tuple[Failure, ...] = ()

    @classmethod
    def of(
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

    @property
    def series(self) -> list[str]:
        """Names of the series, in the study's order."""
        return list(dict.fromkeys(cell.series for cell in self.cells))

    def is_bound(self, series: str) -> bool:
        """Whether a series is one of bounds, not of policies."""
        return any(record.is_bound for record in self.records(series))

    def group_series(self, group: str) -> list[str]:
        """Names of the series of one group."""
        return list(dict.fromkeys(cell.series for cell in self.cells if cell.group == group))

    def places(self, series: str | None = None) -> list[float]:
        """Places on the axis, ascending, of one series or of all."""
        return sorted({c.axis for c in self.cells if series is None or c.series == series})

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
        place = ("group", "series", self.axis.key, "scenario", "scenario_hash", "policy", "seed")
        cost = ("env_steps", "seconds", "energy_kwh", "co2_kg", "search")
        rows.writerow((*place, "episodes", *METRICS, *cost))
        for cell in self.cells:
            record = cell.record
            training = record.training
            emissions = training.emissions if training else None
            rows.writerow(
                (
                    *(cell.group, cell.series, f"{cell.axis:g}", record.scenario),
                    *(record.scenario_hash, record.policy, record.seed, record.episodes),
                    *(
                        f"{record.mean(metric):.{DIGITS}g}" if metric in record.samples else ""
                        for metric in METRICS
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
    return _validated(Results, path, data)


def read_record(path: Path, key: str) -> Record:
    """Read a file of the cell of this key.

    Raises:
        InputError: as `read_results`, or it is the file of another cell.
    """
    data = read_json(path)
    check_version(path, data)
    record = _validated(Record, path, data.get("record"))
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
        InputError: it has.
    """
    found = (data.get("format"), data.get("world_version")) if isinstance(data, dict) else None
    if found != (FORMAT, WORLD_VERSION):
        raise InputError(
            f"{path}: is of another version of this software: format and world version "
            f"{found}, not {(FORMAT, WORLD_VERSION)}; name another folder by --out"
        )


def _validated(model: type[Model], path: Path, data: Any) -> Model:
    try:
        return model.model_validate(data)
    except ValidationError as error:
        problem = error.errors(include_url=False)[0]
        where = ".".join(map(str, problem["loc"]))
        raise InputError(f"{path}: cannot be read: {where}: {problem['msg']}") from None
