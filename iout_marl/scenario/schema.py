"""What a scenario file may say as a whole, and what of it must fit together."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from typing import Annotated, Any, ClassVar, Self

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, Field, field_validator, model_validator

from iout_marl.errors import InputError, did_you_mean
from iout_marl.scenario.data_files import PATH_OF
from iout_marl.scenario.fields import (
    Section,
    Text,
    invalid,
)
from iout_marl.scenario.keys import all_keys, implausible, key_of, ranges_of
from iout_marl.scenario.parts import PartOf, Settings, holders, parts_in, settings_of_kind
from iout_marl.scenario.places import shorten
from iout_marl.scenario.sections import (
    Age,
    Auvs,
    Charging,
    Episode,
    Fairness,
    Grid,
)
from iout_marl.scenario.starts import spread_starts
from iout_marl.scenario.training import Training

#: Sizes beyond which no machine has the memory: cells of a grid, slots of an episode, numbers
#: in a rollout, weights of a network.
MAX_CELLS, MAX_SLOTS, MAX_ROLLOUT, MAX_WEIGHTS = 10**6, 10**9, 10**11, 10**10


class Scenario(Section):
    """A scenario, complete: every setting that affects results."""

    #: What the scenario is called; not part of its hash.
    name: Text = "unnamed"
    #: What is shown beside its name; not part of its hash.
    description: Text = ""
    #: Keys whose values are meant, though they are beyond what any sea or hardware has:
    #: `[harvester.sensitivity_db]`. In the hash where there are any.
    allow_implausible: Annotated[tuple[str, ...], Field(strict=False, max_length=100)] = ()
    grid: Grid
    #: Where the nodes lie.
    nodes: Annotated[Settings, PartOf("placement")]
    auvs: Auvs
    episode: Episode
    #: What sound loses on its way, and what power an uplink takes.
    channel: Annotated[Settings, PartOf("channel")]
    charging: Charging
    #: What a node stores of the sound that reaches it.
    harvester: Annotated[Settings, PartOf("harvester", default="hydrophone")]
    #: What the nodes' energy stores hold, and what they lose.
    storage: Annotated[Settings, PartOf("storage", default="unlimited")] = Field(
        {"kind": "unlimited"}, validate_default=True
    )
    #: How the water moves.
    current: Annotated[Settings, PartOf("current", is_word=True)] = Field(
        "none", validate_default=True
    )
    #: What energy the AUVs have, and what they spend it on.
    vehicle: Annotated[Settings, PartOf("vehicle", default="unlimited")] = Field(
        {"kind": "unlimited"}, validate_default=True
    )
    #: The packets of the nodes, and the band they are sent in.
    uplink: Annotated[Settings, PartOf("uplink", default="shannon")]
    #: How charging and uplink share the slot.
    duplex: Annotated[Settings, PartOf("duplex")]
    #: Which nodes an AUV hears in a slot besides the one that it has chosen.
    hearing: Annotated[Settings, PartOf("hearing", is_word=True)] = Field(
        "one", validate_default=True
    )
    age: Age = Field(default_factory=Age)
    fairness: Fairness = Field(default_factory=Fairness)
    #: What a slot is worth to each AUV.
    reward: Annotated[Settings, PartOf("reward")]
    #: What an AUV sees, and how it is written.
    observation: Annotated[Settings, PartOf("observation", default="paper")] = Field(
        {"kind": "paper"}, validate_default=True
    )
    training: Training

    hash_defaults: ClassVar[dict[str, Any]] = {
        "storage": {"kind": "unlimited"},
        "hearing": "one",
        "vehicle": {"kind": "unlimited"},
        "current": "none",
    }
    not_hashed: ClassVar[frozenset[str]] = frozenset({"name", "description"})

    @field_validator("allow_implausible")
    @classmethod
    def _are_keys_with_a_range(cls, keys: tuple[str, ...]) -> tuple[str, ...]:
        for i, key in enumerate(keys):
            if key not in ranges_of(cls):
                shown = shorten(key)
                if key in all_keys(cls):
                    raise invalid((i,), f"{shown!r} has no plausible range that could be left")
                hint = did_you_mean(shown, ranges_of(cls), or_list=False)
                raise invalid((i,), f"unknown key {shown!r}{hint}")
        return tuple(sorted(set(keys)))

    @model_validator(mode="after")
    def _check_as_a_whole(self) -> Self:
        self._check_grid()
        self._check_parts_from_outside()
        self.nodes.part.check(self)
        self._check_starts()
        self._check_plausibility()
        self._check_slots()
        self._check_training()
        entries = self.observation.entries
        for settings in (
            self.auvs.motion,
            self.observation,
            self.channel,
            self.harvester,
            self.uplink,
            self.storage,
            self.vehicle,
            self.current,
            self.duplex,
            self.hearing,
            self.reward,
            *entries,
            self.training.network,
        ):
            settings.part.check(self)
        return self

    def _check_parts_from_outside(self) -> None:
        for path, settings in parts_in(self):
            if settings.entry.is_outside:
                try:
                    with settings.entry.blamed():
                        settings.part.check_stated(self)
                except InputError as error:
                    raise invalid(path, str(error)) from error

    def _check_plausibility(self) -> None:
        doubts = [
            (path, doubt)
            for path, doubt in implausible(self)
            if key_of(path) not in self.allow_implausible
        ]
        if doubts:
            path, doubt = doubts[0]
            keys = {key_of(other) for other, _ in doubts}
            others = ", ".join(sorted(keys - {key_of(path)}))
            also = f"; so is {others}" if others else ""
            allowed = ", ".join(sorted(keys | set(self.allow_implausible)))
            raise invalid(
                path, f"{doubt}{also}; if it is meant, write allow_implausible: [{allowed}]"
            )

    def _check_grid(self) -> None:
        if math.prod(self.grid.cells) > MAX_CELLS:
            raise invalid(
                ("grid", "cells"), f"must be at most {MAX_CELLS:,} cells, not {self.size_of_grid}"
            )

    def _check_slots(self) -> None:
        slot_key = ("episode", "slot_s")
        if self.episode.slot_s is None:
            slot_key = ("grid", "spacing_m")
        if self.episode.duration_s < self.slot_s:
            raise invalid(
                ("episode", "duration_s"),
                f"must hold at least one slot of {self.slot_s:g} s",
                beside=slot_key,
            )
        if self.episode.duration_s / self.slot_s > MAX_SLOTS:
            raise invalid(
                ("episode", "duration_s"),
                f"must hold at most {MAX_SLOTS:,} slots of {self.slot_s:g} s",
                beside=slot_key,
            )
        edges_m = [m for m, n in zip(self.grid.edges_m, self.grid.cells, strict=True) if n > 1]
        shortest_s = min(edges_m, default=0.0) / self.auvs.speed_m_per_s
        if self.episode.duration_s < shortest_s:
            raise invalid(
                ("episode", "duration_s"),
                f"must be as long as a move to the next cell, {shortest_s:g} s",
                beside=("auvs", "speed_m_per_s"),
            )

    def _check_training(self) -> None:
        training = self.training
        samples = training.environments * training.rollout_slots * self.num_auvs
        if samples < 2:
            raise invalid(("training", "rollout_slots"), "must give a rollout of 2 samples or more")
        if training.minibatches > samples:
            raise invalid(
                ("training", "minibatches"),
                f"must not exceed the {samples:,} samples of a rollout",
                beside=("training", "environments"),
            )
        numbers = samples * (2 * self.num_nodes + 3)
        if numbers > MAX_ROLLOUT:
            raise invalid(
                ("training", "rollout_slots"),
                f"makes a rollout of some {numbers:.2g} numbers: {MAX_ROLLOUT:g} at most",
                beside=("training", "environments"),
            )
        units = (2 * self.num_nodes + 3, *training.hidden_units, 2 * self.num_nodes)
        weights = sum(below * above for below, above in itertools.pairwise(units))
        if weights > MAX_WEIGHTS:
            raise invalid(
                ("training", "hidden_units"),
                f"make a network of some {weights:.2g} weights: {MAX_WEIGHTS:g} at most",
            )

        if training.over:
            self._check_over()

    def _check_over(self) -> None:
        training = self.training
        if not self.observation.part.is_table:
            raise invalid(
                ("observation", "kind"),
                "must be table for training.over: other observations are of one size, not "
                f"{self.observation.kind}",
                beside=("training", "over"),
            )
        if self.nodes.part.redraws == "run":
            raise invalid(
                ("nodes", "redraw"),
                "must be episode for training.over, which plays new layouts, not run",
                beside=("training", "over"),
            )
        if training.discount == 1:
            raise invalid(
                ("training", "discount"),
                "must be below 1 for training.over, which estimates what lies beyond an episode",
                beside=("training", "over"),
            )

    @property
    def size_of_grid(self) -> str:
        """Cells along x, y and z, in words."""
        return " × ".join(map(str, self.grid.cells))

    def check_cell(self, path: tuple[str | int, ...], cell: tuple[int, int, int]) -> None:
        """Refuse a cell, written at `path`, that the grid does not have."""
        if any(c > size for c, size in zip(cell, self.grid.cells, strict=True)):
            raise invalid(
                path,
                f"cell {list(cell)} lies outside the grid of {self.size_of_grid} cells",
                beside=("grid", "cells"),
            )

    def _check_starts(self) -> None:
        auvs = self.auvs
        seen: set[tuple[int, int, int]] = set()
        for i, cell in enumerate(auvs.start_cells):
            self.check_cell(("auvs", "start_cells", i), cell)
            if cell in seen:
                raise invalid(
                    ("auvs", "start_cells", i),
                    f"cell {list(cell)} is the start of two AUVs; each needs one of its own",
                )
            seen.add(cell)
            for other in auvs.start_cells[: min(i, self.num_auvs)]:
                if i < self.num_auvs and math.dist(cell, other) < auvs.separation_cells:
                    raise invalid(
                        ("auvs", "start_cells", i),
                        f"cell {list(cell)} lies nearer to {list(other)} than "
                        f"auvs.separation_cells, {auvs.separation_cells:g}",
                        beside=("auvs", "separation_cells"),
                    )
        if self.num_auvs > math.prod(self.grid.cells):
            raise invalid(
                ("auvs", "count"),
                f"is {self.num_auvs}, but the grid has only {math.prod(self.grid.cells)} cells: "
                "each AUV starts in one of its own",
                beside=("grid", "cells"),
            )
        may_lack_room = auvs.separation_cells > 1 or not all(auvs.motion.part.axes_moved)
        if may_lack_room and self.num_auvs > len(auvs.start_cells):
            found = len(self.starts())
            if found < self.num_auvs:
                raise invalid(
                    ("auvs", "count"),
                    f"is {self.num_auvs}, but only {found} AUVs find room at "
                    f"auvs.separation_cells, {auvs.separation_cells:g}",
                    beside=("auvs", "separation_cells"),
                )

    def starts(self) -> npt.NDArray[np.int64]:
        """Coordinates from 0 of the cells in which the AUVs start, (auvs, 3)."""
        auvs = self.auvs
        rule = self.grid.cells, auvs.separation_cells, auvs.motion.part.axes_moved
        return spread_starts(auvs.start_cells, self.num_auvs, *rule)

    @property
    def num_nodes(self) -> int:
        """K."""
        count: int = self.nodes.part.num_nodes
        return count

    @property
    def num_auvs(self) -> int:
        """M."""
        return self.auvs.count or len(self.auvs.start_cells)

    @property
    def may_be_idle(self) -> bool:
        """Whether an AUV may charge and hear nobody: by choice, or for want of energy."""
        return bool(self.auvs.idle_choices or self.vehicle.part.is_limited)

    @property
    def slot_s(self) -> float:
        """τ in s: `episode.slot_s`, or the time the AUV takes for one cell along its longest edge.

        By the latter every step along an axis fits into a slot.
        """
        if self.episode.slot_s is not None:
            return self.episode.slot_s
        return max(self.grid.edges_m) / self.auvs.speed_m_per_s

    @property
    def num_slots(self) -> int:
        """Slots of an episode."""
        # A quotient such as 0.3/0.1 falls short of its whole number by a rounding.
        return math.floor(self.episode.duration_s / self.slot_s * (1 + 1e-12))

    @property
    def slot_middles_s(self) -> npt.NDArray[np.float64]:
        """(slots,) seconds from the start of the episode to the middle of every slot."""
        return (np.arange(self.num_slots) + 0.5) * np.float64(self.slot_s)

    @property
    def node_weights(self) -> tuple[float, ...]:
        """δ_k of every node."""
        weights: tuple[float, ...] | None = self.nodes.part.weights
        return weights or (1.0,) * self.num_nodes

    @property
    def seen(self) -> tuple[Settings, ...]:
        """The entries of an AUV's observation, in their order."""
        kinds = self.observation.part.kinds(self)
        return (
            *(settings_of_kind("observation entry", kind) for kind in kinds),
            *self.observation.entries,
        )

    @property
    def hash(self) -> str:
        """12 hexadecimal digits that change with every setting that affects results."""
        return self._digest(*(() if self.allow_implausible else ("allow_implausible",)))

    @property
    def world_hash(self) -> str:
        """As `hash`, of the world alone: without the reward and the training settings."""
        return self._digest("reward", "training", "allow_implausible")

    def _digest(self, *without: str) -> str:
        text = self.model_dump_json(exclude=set(without), context={PATH_OF: None})
        # Adding 0 makes −0.0, which equals 0.0, the same in writing too.
        data = json.loads(text, parse_float=lambda number: float(number) + 0.0)
        origin, hashed = data["grid"]["origin"], _hashed(self, data)
        if origin and any(settings.part.reads_origin for _, settings in parts_in(self)):
            hashed["grid"]["origin"] = origin
        text = json.dumps(hashed, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:12]


def _hashed(section: BaseModel, data: Any) -> Any:
    """What of a section's data is in the hash: all but keys that mean as before they came."""
    version = section.entry.version if isinstance(section, Settings) else None
    if isinstance(data, dict):
        for name, inner in section.__dict__.items():
            if name not in data:
                continue
            if isinstance(inner, BaseModel):
                data[name] = _hashed(inner, data[name])
            elif isinstance(inner, tuple) and inner and isinstance(inner[0], BaseModel):
                data[name] = [_hashed(*pair) for pair in zip(inner, data[name], strict=True)]
        kind = section if isinstance(section, Section) else Section
        defaults, left_out = kind.hash_defaults, kind.not_hashed
        data = {
            key: value
            for key, value in data.items()
            if key not in left_out and not (key in defaults and value == defaults[key])
        }
    if version is None:
        return data
    return {**(data if isinstance(data, dict) else {"kind": data}), "version": version}


holders += (Auvs, Training, Scenario)
