"""From a study to its cells: one scenario, one policy, one seed each."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from iout_marl.errors import InputError
from iout_marl.scenario import Scenario, load_scenario
from iout_marl.scenario.layers import Layer, overrides_layer
from iout_marl.study.schema import BOUND, PLANNER, TRAINED, Group, Quick, Settings, Study
from iout_marl.world import WORLD_VERSION, draws_layout_once

#: Environment steps that are trained in a second, and in the time of a planner's round, about.
STEPS_PER_SECOND, STEPS_PER_ROUND = 2e5, 4e5


@dataclass(frozen=True)
class Cell:
    """A cell of a study.

    Attributes:
        group, series: where the report shows it.
        axis: its place on the study's axis.
        scenario: the scenario, settings filled in.
        policy: a baseline, `ppo`, or `bound`.
        seed: seeds the training, or a baseline's choices, and a layout drawn once for a run.
        episodes: how many episodes it is judged by.
        planner_rounds: how long the planner searches; None for the usual, and for others.
        bound_seconds: how long a bound is searched for; None for others.
    """

    group: str
    series: str
    axis: float
    scenario: Scenario
    policy: str
    seed: int
    episodes: int
    planner_rounds: int | None = None
    bound_seconds: float | None = None

    @property
    def trains(self) -> bool:
        """Whether a policy is trained."""
        return self.policy == TRAINED

    @property
    def key(self) -> str:
        """Name of its files: the same for cells that compute the same."""
        identity = [self.scenario.hash, self.policy, self.seed, self.episodes, WORLD_VERSION]
        identity += [e for e in (self.planner_rounds, self.bound_seconds) if e is not None]
        digest = hashlib.sha256(json.dumps(identity).encode()).hexdigest()[:10]
        name = re.sub(r"[^\w.-]+", "-", self.scenario.name)
        return f"{name}-{self.policy}-s{self.seed}-{digest}"

    @property
    def cost(self) -> float:
        """How long it takes, roughly, in environment steps."""
        if self.bound_seconds is not None:
            return self.bound_seconds * STEPS_PER_SECOND
        if self.planner_rounds is not None:
            return self.planner_rounds * STEPS_PER_ROUND
        evaluation = self.episodes * self.scenario.num_slots
        return evaluation + (self.scenario.training.steps if self.trains else 0)

    def describe(self) -> str:
        """In a few words."""
        return f"{self.series}, {self.scenario.name}, seed {self.seed}"


def expand(
    study: Study, layer: Layer, overrides: Sequence[str] = (), *, quick: bool = False
) -> list[Cell]:
    """The cells of a study, group by group.

    Args:
        study: the study.
        layer: where its keys were written.
        overrides: `key=value` over every scenario.
        quick: only what `quick` leaves of it.

    Raises:
        InputError: a scenario that is none, a setting that does not fit, an axis that is
            no number, two cells that are the same, or no cell at all.
    """
    over = dict(_flat(overrides_layer(overrides).data))
    cells = [
        cell
        for name, group in study.groups.items()
        if not (quick and name in study.quick.without)
        for cell in _expand_group(study, layer, name, group, over, quick=quick)
    ]
    if quick and study.quick.axis is not None:
        cells = [cell for cell in cells if cell.axis in study.quick.axis]
    if not cells:
        where = layer.origin(("quick",) if quick else ("groups",))
        raise InputError(f"{where}: the study has no cell" + (" left by --quick" if quick else ""))
    bounds = {cell.series for cell in cells if cell.policy == BOUND}
    for cell in cells:
        if cell.series in bounds and cell.policy != BOUND:
            where = layer.origin(("groups", cell.group, "series"))
            raise InputError(
                f"{where}: groups.{cell.group}: the series {cell.series!r} has bounds and "
                "policies; tell them apart in `series` by {policy}"
            )
    places = Counter((cell.series, cell.axis, cell.seed) for cell in cells)
    for cell in cells:
        if places[cell.series, cell.axis, cell.seed] > 1:
            where = layer.origin(("groups", cell.group, "series"))
            raise InputError(
                f"{where}: groups.{cell.group}: two cells of the series {cell.series!r} share "
                f"the place {cell.axis:g} on the axis and the seed {cell.seed}; tell them apart "
                "in `series` by {policy}, {variant} or a key of the grid"
            )
    return cells


def _expand_group(
    study: Study, layer: Layer, name: str, group: Group, overrides: Settings, *, quick: bool
) -> Iterator[Cell]:
    short = study.quick if quick else Quick()
    rounds = group.planner_rounds if short.planner_rounds is None else short.planner_rounds
    seconds = group.bound_seconds if short.bound_seconds is None else short.bound_seconds
    last = {**short.settings, **overrides}
    points = itertools.product(enumerate(group.scenarios), group.variants.items(), _grid(group))
    for (i, source), (variant, changes), point in points:
        where = layer.origin(("groups", name, "scenarios", i))
        try:
            scenario = load_scenario(source, {**group.settings, **changes, **point, **last})
        except InputError as error:
            raise InputError(f"{where}: groups.{name}: {error}") from None
        axis = _axis(scenario, study, layer)
        for policy, seed in itertools.product(group.policies, group.seeds[: short.seeds]):
            if policy == BOUND and seed != group.seeds[0] and not draws_layout_once(scenario):
                continue  # one bound holds for all
            series = _series(group, where, name, {"policy": policy, "variant": variant, **point})
            yield Cell(
                name,
                series,
                axis,
                scenario,
                policy,
                seed,
                episodes=1 if policy == BOUND else group.episodes,
                planner_rounds=rounds if policy == PLANNER else None,
                bound_seconds=seconds if policy == BOUND else None,
            )


def _grid(group: Group) -> Iterator[Settings]:
    for values in itertools.product(*group.grid.values()):
        yield dict(zip(group.grid, values, strict=True))


def _series(group: Group, where: str, name: str, fields: Mapping[str, Any]) -> str:
    def fill(match: re.Match[str]) -> str:
        if match[1] not in fields:
            known = ", ".join(f"{{{field}}}" for field in fields)
            raise InputError(f"{where}: groups.{name}.series: unknown {match[0]} (known: {known})")
        return str(fields[match[1]])

    series = re.sub(r"\{([^{}]*)\}", fill, group.series).strip()
    if not series:
        raise InputError(f"{where}: groups.{name}.series: must not be empty")
    return series


def _axis(scenario: Scenario, study: Study, layer: Layer) -> float:
    counts = {"nodes.count": scenario.num_nodes, "auvs.count": scenario.num_auvs}
    value: Any = counts.get(study.axis.key)
    if value is None:
        value = scenario.model_dump()
        for key in study.axis.key.split("."):
            value = value.get(key) if isinstance(value, dict) else None
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        where = layer.origin(("axis", "key"))
        raise InputError(
            f"{where}: axis.key: {study.axis.key!r} is no number in {scenario.name}, but {value!r}"
        )
    return float(value)


def _flat(data: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in data.items():
        if isinstance(value, dict) and value:
            yield from _flat(value, f"{path}{key}.")
        else:
            yield f"{path}{key}", value
