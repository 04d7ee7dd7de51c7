"""The record of a cell: its figures, its training, an episode; each checked when it is read."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any, Self, TypeAlias

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    model_validator,
)

from iout_marl import machine
from iout_marl.evaluation import METRICS
from iout_marl.metrics import BUILTIN, described
from iout_marl.scenario.fields import Fraction, invalid
from iout_marl.study.cells import Cell
from iout_marl.study.fields import (
    LARGEST,
    Counted,
    NotNegative,
    Number,
    Positive,
    Whole,
    Words,
    show,
)
from iout_marl.study.schema import BOUND, Seed
from iout_marl.world import pin_layout

#: Digits that are kept of a figure.
DIGITS = 7
#: What of a training's log is kept.
CURVES = tuple(metric.tag for metric in BUILTIN if metric.has_curve)
#: Settings of a training that reports calculate with.
_NUMBERS = ("discount", "learning_rate", "steps")


def _check_setting(value: Any) -> Any:
    for one in value if isinstance(value, list) else [value]:
        if isinstance(one, int | float) and abs(one) <= LARGEST:
            continue
        if not (one is None or isinstance(one, str)) or show(one or "") != (one or ""):
            raise invalid((), "must be a number, a word, true, false, null or a list of them")
    return value


_Setting: TypeAlias = Annotated[Any, AfterValidator(_check_setting)]
_Place: TypeAlias = Annotated[list[Counted], Field(min_length=3, max_length=3)]
#: An edge for each axis; where all are equal, it is written once.
_Edges: TypeAlias = Annotated[
    list[Positive],
    Field(min_length=3, max_length=3),
    BeforeValidator(lambda value: value if isinstance(value, list) else [value] * 3),
]
#: A list for each AUV, for each node.
_OfEach: TypeAlias = Annotated[list[Whole], Field(min_length=1)]


class Saved(BaseModel):
    """A part of a file of results: as it was written, to the type, and finite."""

    model_config = ConfigDict(frozen=True, strict=True, allow_inf_nan=False)


class Emissions(Saved):
    """What a training took, by codecarbon."""

    energy_kwh: Positive
    co2_kg: NotNegative
    codecarbon: Words  # its version


class TrainingRecord(Saved):
    """A training: by which settings, how long it took, and how it went.

    `curve` has a list for each of `env_steps` and `CURVES`, of the episodes of each rollout.
    """

    settings: dict[Words, _Setting]
    env_steps: Whole
    seconds: Positive
    curve: dict[Words, list[Number]]
    emissions: Emissions | None

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        for key in _NUMBERS:
            value = self.settings.get(key)
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise invalid(("settings", key), "must be a number")
        lengths = {name: len(self.curve.get(name, ())) for name in ("env_steps", *CURVES)}
        for name in lengths:
            if name not in self.curve:
                raise invalid(("curve", name), "is missing")
        if len(set(lengths.values())) > 1:
            raise invalid(("curve",), f"has lists of different lengths: {lengths}")
        return self


class _Episode(Saved):
    """What `iout_marl.trajectory.Trajectory` holds, cell by cell and slot by slot."""

    grid: _Place
    spacing_m: _Edges
    nodes: Annotated[list[_Place], Field(min_length=1)]
    path: Annotated[list[Annotated[list[_Place], Field(min_length=1)]], Field(min_length=2)]
    charged: list[_OfEach]
    heard: list[_OfEach]
    delivered: list[Annotated[list[bool], Field(min_length=1)]]
    ages: list[Annotated[list[NotNegative], Field(min_length=1)]]
    polled: list[Annotated[list[list[Counted]], Field(min_length=1)]] | None = None
    polled_delivered: list[Annotated[list[list[bool]], Field(min_length=1)]] | None = None
    docks: Annotated[list[_Place], Field(min_length=1)] | None = None

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        slots, auvs, nodes = len(self.path) - 1, len(self.path[0]), len(self.nodes)
        for name, length, width in (
            ("path", slots + 1, auvs),
            ("charged", slots, auvs),
            ("heard", slots, auvs),
            ("delivered", slots, auvs),
            ("ages", slots, nodes),
        ):
            rows: Sequence[Sequence[Any]] = getattr(self, name)
            if len(rows) != length or any(len(row) != width for row in rows):
                raise invalid((name,), f"must have {length} rows of {width}")
        for name, places in (
            ("nodes", self.nodes),
            ("path", (p for row in self.path for p in row)),
            ("docks", self.docks or ()),
        ):
            if any(c > size for p in places for c, size in zip(p, self.grid, strict=True)):
                raise invalid((name,), "leaves the grid")
        for name in ("charged", "heard"):
            if any(node > nodes for row in getattr(self, name) for node in row):
                raise invalid((name,), f"names a node beyond the last, {nodes}")
        self._polls_fit_together(slots, auvs, nodes)
        return self

    def _polls_fit_together(self, slots: int, auvs: int, nodes: int) -> None:
        polled, arrived = self.polled, self.polled_delivered
        if (polled is None) != (arrived is None):
            raise invalid(("polled",), "and polled_delivered go together")
        if polled is None or arrived is None:
            return
        for name, rows in (("polled", polled), ("polled_delivered", arrived)):
            if len(rows) != slots or any(len(row) != auvs for row in rows):
                raise invalid((name,), f"must have {slots} rows of {auvs}")
        pairs = [pair for rows in zip(polled, arrived, strict=True) for pair in zip(*rows)]  # noqa: B905
        if any(len(named) != len(packets) for named, packets in pairs):
            raise invalid(("polled_delivered",), "must say it of each node of polled")
        if any(node > nodes for named, _ in pairs for node in named):
            raise invalid(("polled",), f"names a node beyond the last, {nodes}")


class Record(Saved):
    """What a cell has computed.

    `samples` has every metric of every episode that was played, those of users after the
    built-in ones, of a bound the one that it bounds; a single episode stands for all where
    `deterministic`. `episode` is the first one in full, of policies that were trained (see
    `iout_marl.trajectory.Trajectory`). `world_hash` is that of the world that was played: of one
    layout, where one was drawn. `search` says how a bound was found and, after a semicolon, which
    parts from outside it takes at their word, or how long a plan was searched for. `trained_in` is
    the scenario that a policy was trained in, with its hash, where that is another.
    """

    key: Words
    scenario: Words
    scenario_hash: Words
    world_hash: Words
    duplex: Words
    nodes: Counted
    auvs: Counted
    maximum_age: Positive
    minimum_jain: Fraction
    policy: Words
    seed: Seed
    episodes: Counted
    samples: dict[Words, list[Number]]
    training: TrainingRecord | None
    episode: dict[str, Any] | None
    machine: dict[Words, Words]
    date: Words
    search: Words = ""
    deterministic: bool = False
    trained_in: Words = ""

    @classmethod
    def from_cell(
        cls,
        cell: Cell,
        samples: Mapping[str, Any],
        date: str,
        training: TrainingRecord | None = None,
        episode: dict[str, Any] | None = None,
        search: str = "",
        *,
        deterministic: bool = False,
    ) -> Self:
        """The record of a cell on this machine."""
        scenario, trained = cell.scenario, cell.trained_in
        kept = {name: rounded(values) for name, values in samples.items()}
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
            episodes=len(kept["mean_aoi"]),
            samples=kept,
            training=training,
            episode=episode,
            machine={name: show(value) for name, value in machine.describe().items()},
            date=date,
            search=search,
            deterministic=deterministic,
            trained_in=f"{trained.name}, {trained.hash}" if trained else "",
        )

    @model_validator(mode="after")
    def _has_every_sample(self) -> Self:
        for name in dict.fromkeys((*metrics_of(self.policy), *self.samples)):
            values = self.samples.get(name, [])
            if len(values) != self.episodes:
                raise invalid(("samples", name), "must hold a number for each episode")
            metric = described(name)
            # Of users' metrics the bounds are checked where they are computed: here they may be
            # registered otherwise by now.
            if not metric.is_builtin:
                continue
            if min(values) < metric.low or max(values) > metric.high:
                limits = f"{metric.low:g} and {metric.high:g}"
                raise invalid(("samples", name), f"must lie between {limits}")
            if metric.is_positive and min(values) < 1 / LARGEST:
                raise invalid(("samples", name), "must lie above 0")
        return self

    @model_validator(mode="after")
    def _has_an_episode_of_its_world(self) -> Self:
        if self.episode is None:
            return self
        try:
            episode = _Episode.model_validate(self.episode)
        except ValidationError as error:
            problem = error.errors(include_url=False)[0]
            path = (*problem["loc"], *problem.get("ctx", {}).get("path", ()))
            raise invalid(("episode", *path), problem["msg"]) from None
        if (len(episode.nodes), len(episode.path[0])) != (self.nodes, self.auvs):
            raise invalid(("episode",), f"must be of {self.nodes} nodes and {self.auvs} AUVs")
        return self

    @property
    def is_bound(self) -> bool:
        """Whether it is no policy's, but what none can beat."""
        return self.policy == BOUND

    def mean(self, metric: str) -> float:
        """A metric's mean over the episodes."""
        return float(np.mean(self.samples[metric]))


def metrics_of(policy: str) -> tuple[str, ...]:
    """What is known of every policy, or of a bound."""
    return ("mean_aoi",) if policy == BOUND else METRICS


def rounded(values: Iterable[float]) -> list[float]:
    """Plain numbers of `DIGITS` digits."""
    return [float(f"{value:.{DIGITS}g}") for value in values]
