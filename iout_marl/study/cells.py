"""From a study to its cells: one scenario, one policy, one seed each."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import re
import shlex
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from iout_marl.errors import InputError
from iout_marl.files import path_from
from iout_marl.outside import brought_in
from iout_marl.scenario import Scenario, find_scenario, load_scenario
from iout_marl.scenario.layers import Layer, overrides_layer
from iout_marl.scenario.placeholders import fill_placeholders
from iout_marl.scenario.presets import names_preset
from iout_marl.study.fields import LARGEST, LONGEST, show
from iout_marl.study.schema import BOUND, PLANNER, TRAINED, Group, Quick, Settings, Study
from iout_marl.world import WORLD_VERSION, draws_layout_once

#: More cells than anyone runs, and than a report can show.
MAX_CELLS = 10_000
#: Environment steps that are trained in a second, and in the time of a planner's round, about.
STEPS_PER_SECOND, STEPS_PER_ROUND = 2e5, 4e5


@dataclass(frozen=True)
class Cell:
    """A cell of a study.

    Attributes:
        group, series: where the report shows it.
        axis: its place on the study's axis.
        scenario: the scenario, settings filled in.
        policy: a baseline, `ppo`, `bound`, or one from outside, `MODULE:NAME`.
        seed: seeds the training, or a baseline's choices, and a layout drawn once for a run.
        episodes: how many episodes it is judged by.
        planner_rounds: how long the planner searches; None for the usual, and for others.
        bound_seconds: how long a bound is searched for; None for others.
        variant: the name of its variant; may be empty.
        place: its values of the grid and of the axis, `key=value` each.
        imports: what brings its parts and metrics from outside.
        trained_in: the scenario that its policy is trained in, where that is another.
        run: then the files of the run that was trained, by name, once there is one.
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
    variant: str = ""
    place: tuple[str, ...] = ()
    imports: tuple[str, ...] = ()
    trained_in: Scenario | None = None
    run: Mapping[str, bytes] = field(default_factory=dict, repr=False)

    @property
    def trains(self) -> bool:
        """Whether a policy is trained."""
        return self.policy == TRAINED and self.trained_in is None

    @property
    def training(self) -> Cell | None:
        """The cell whose run it plays, where it is trained in another scenario."""
        if self.trained_in is None:
            return None
        return replace(self, scenario=self.trained_in, trained_in=None, variant="", place=())

    @property
    def key(self) -> str:
        """Name of its files: the same for cells that compute the same."""
        identity = [self.scenario.hash, self.policy, self.seed, self.episodes, WORLD_VERSION]
        identity += [e for e in (self.planner_rounds, self.bound_seconds) if e is not None]
        identity += [self.trained_in.hash] if self.trained_in else []
        digest = hashlib.sha256(json.dumps(identity).encode()).hexdigest()[:10]
        name = re.sub(r"[^\w.-]+", "-", f"{self.scenario.name}-{self.policy}")
        return f"{name}-s{self.seed}-{digest}"

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
        """In a few words, which no other cell of the study shares."""
        kind = [word for word in (self.policy, self.variant) if word not in self.series]
        return ", ".join([self.series, *kind, self.scenario.name, *self.place, f"seed {self.seed}"])


def expand(
    study: Study,
    layer: Layer,
    overrides: Sequence[str] = (),
    outside: Sequence[str] = (),
    *,
    quick: bool = False,
) -> list[Cell]:
    """The cells of a study, group by group.

    Args:
        study: the study.
        layer: where its keys were written.
        overrides: `key=value` over every scenario.
        outside: policies from outside that the study may have, `MODULE:NAME`: what a file
            names is never imported unless whoever runs the study has named it, too.
        quick: only what `quick` leaves of it.

    Scenarios and training presets are looked for in the folder of the study's file, then
    among the bundled ones. `overrides` name a preset as they do for any scenario.

    Raises:
        InputError: a scenario that is none, a setting that does not fit, a policy from outside
            that nobody has named, an axis that is no number, two cells that are the same, no
            cell at all, or far too many.
    """
    _check_size(study, layer, quick=quick)
    _check_outside(study, layer, outside)
    over = overrides_layer(overrides)
    cells = [
        cell
        for name, group in study.groups.items()
        if not (quick and name in study.quick.without)
        for cell in _expand_group(study, layer, name, group, over, quick=quick)
    ]
    if quick and study.quick.axis is not None:
        kept = set(study.quick.axis)
        cells = [cell for cell in cells if {cell.axis, study.axis.text(cell.axis)} & kept]
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
    study: Study, layer: Layer, name: str, group: Group, overrides: Layer, *, quick: bool
) -> Iterator[Cell]:
    short = study.quick if quick else Quick()
    rounds = group.planner_rounds if short.planner_rounds is None else short.planner_rounds
    seconds = group.bound_seconds if short.bound_seconds is None else short.bound_seconds
    study_file = Path(layer.origin(()))
    beside = None if names_preset(overrides) else study_file

    def load(source: str, where: str, *changes: Settings) -> Scenario:
        settings: Settings = {}
        for each in (group.settings, *changes, short.settings):
            settings |= each
        try:
            above = overrides.over(overrides_layer(settings, study_file))
            return load_scenario(_find(source, study_file), above, beside=beside)
        except InputError as error:
            raise InputError(f"{where}: groups.{name}: {error}") from None

    points = itertools.product(enumerate(group.scenarios), group.variants.items(), _grid(group))
    for (i, source), (variant, changes), point in points:
        where = layer.origin(("groups", name, "scenarios", i))
        scenario = load(source, where, changes, point)
        trained_in = None
        if group.trained_with is not None:
            trained_in = load(source, where, group.trained_with)
            if trained_in.hash == scenario.hash:
                trained_in = None
        axis = study.axis.place(variant) if study.axis.variants else _axis(scenario, study, layer)
        place = [f"{key}={value}" for key, value in point.items()]
        place += (
            [f"{study.axis.name}={study.axis.text(axis)}"] if study.axis.name not in point else []
        )
        for policy, seed in itertools.product(group.policies, group.seeds[: short.seeds]):
            if policy == BOUND and seed != group.seeds[0] and not draws_layout_once(scenario):
                continue  # one bound holds for all
            series = _series(group, where, name, {"policy": policy, "variant": variant, **point})
            _check_words(where, name, scenario.name, series)
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
                variant=variant,
                place=tuple(place),
                imports=brought_in(),
                trained_in=trained_in,
            )


def _check_outside(study: Study, layer: Layer, outside: Sequence[str]) -> None:
    """No file makes code run: policies from outside are named by whoever runs the study."""
    listed = [
        (policy, layer.origin(("groups", name, "policies", i)), name)
        for name, group in study.groups.items()
        for i, policy in enumerate(group.policies)
        if ":" in policy
    ]
    for policy, where, name in listed:
        if policy not in outside:
            raise InputError(
                f"{where}: groups.{name}: policies from outside must be named on the command "
                f"line, too: --policy {shlex.quote(policy)}"
            )
    for policy in outside:
        if all(policy != each for each, *_ in listed):
            raise InputError(
                f"--policy {policy}: the study has no such policy; its groups list their policies"
            )


def _check_size(study: Study, layer: Layer, *, quick: bool) -> None:
    """Before anything is expanded: a few lines can ask for more than a lifetime computes."""
    total = 0
    for name, group in study.groups.items():
        if quick and name in study.quick.without:
            continue
        factors = (group.scenarios, group.variants, *group.grid.values(), group.policies)
        seeds = group.seeds[: study.quick.seeds] if quick else group.seeds
        total += math.prod(map(len, (*factors, seeds)))
        if total > MAX_CELLS:
            where = layer.origin(("groups", name))
            raise InputError(
                f"{where}: groups.{name}: scenarios × variants × grid × policies × seeds make "
                f"more than {MAX_CELLS:,} cells, the most that a study may have"
            )


def _find(source: str, study_file: Path) -> Path:
    """The file of a scenario that a study names."""
    try:
        return find_scenario(source, beside=study_file)
    except InputError as error:
        try:
            here = find_scenario(source)
        except InputError:
            raise error from None
        way = path_from(here, study_file.parent)
        raise InputError(f"{error}; from the study's own folder it is {way!r}") from None


def _check_words(where: str, group: str, *texts: str) -> None:
    """What tables and figures show must be of a size and without control characters."""
    for text in texts:
        if show(text) != text or len(text) > LONGEST:
            raise InputError(
                f"{where}: groups.{group}: the name {text[:40]!r} must have one line of at most "
                f"{LONGEST:,} characters, and no control character"
            )


def _grid(group: Group) -> Iterator[Settings]:
    for values in itertools.product(*group.grid.values()):
        yield dict(zip(group.grid, values, strict=True))


def _series(group: Group, where: str, name: str, fields: Mapping[str, Any]) -> str:
    series = fill_placeholders(group.series, fields, f"{where}: groups.{name}.series").strip()
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
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not (is_number and abs(value) <= LARGEST):
        where = layer.origin(("axis", "key"))
        raise InputError(
            f"{where}: axis.key: {study.axis.key!r} is no number in {scenario.name}, but {value!r}"
        )
    return float(value)
