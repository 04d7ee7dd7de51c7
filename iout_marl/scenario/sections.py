"""The sections of a scenario file but for its training: every key, its unit, its range.

Units stand in the names of the fields. Cells are counted from 1, as in the paper.
Sections and keys that name a part have the settings of a registered kind: see `iout_marl.parts`.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, field_validator, model_validator

from iout_marl.scenario.fields import (
    MAX_AUVS,
    Cell,
    Count,
    Depth,
    Directivity,
    Efficiency,
    Fraction,
    NonNegative,
    Plausible,
    Positive,
    Section,
    Slots,
    invalid,
)
from iout_marl.scenario.parts import PartOf, Settings
from iout_marl.scenario.spacing import Edges, Spacing, SpacingField, edges_m, shortest_form


class Origin(Section):
    """The place of a grid on Earth, in WGS-84: that of the centre of cell (1, 1, 1)."""

    #: Latitude, north of the equator above 0.
    latitude_deg: Annotated[float, Field(ge=-90, le=90)]
    #: Longitude, east of Greenwich above 0.
    longitude_deg: Annotated[float, Field(ge=-180, le=180)]
    #: Depth below the surface of the uppermost layer's centre.
    depth_m: Depth = 0.0
    #: Direction of +y clockwise from north; +x lies 90° to its right, and +z points down.
    bearing_deg: Annotated[float, Field(ge=0, lt=360)] = 0.0


class Grid(Section):
    """The water, cut into cells: cubes, or boxes of three edges."""

    #: Cells along x, y and z.
    cells: Annotated[Cell, Plausible(1, 1000, "cells")]
    #: Edge of a cell; or its edges along x, y and z, of which three equal ones are the same as
    #: that number. One slot is the time the AUV takes for the longest edge, unless
    #: `episode.slot_s` says otherwise.
    spacing_m: Annotated[SpacingField, Plausible(0.01, 10_000, "m")]
    #: Distance between an AUV and a node in the same cell, and between AUVs in it: `zero`, or the
    #: `mean` distance between two points drawn uniformly in the cell (0.6617 edges of a cube).
    own_cell_distance: Literal["zero", "mean"] = "zero"
    #: Where the grid lies on Earth, which mission files need; null for nowhere. Part of the hash
    #: only where results depend on it, as by currents from files and losses by depth.
    origin: Origin | None = None

    hash_defaults: ClassVar[dict[str, Any]] = {"own_cell_distance": "zero"}
    not_hashed: ClassVar[frozenset[str]] = frozenset({"origin"})

    @field_validator("spacing_m")
    @classmethod
    def _in_one_form(cls, spacing_m: Spacing) -> Spacing:
        return shortest_form(spacing_m)

    @property
    def edges_m(self) -> Edges:
        """The edges of a cell along x, y and z in m."""
        return edges_m(self.spacing_m)


class Auvs(Section):
    """The vehicles."""

    #: Cell in which each AUV starts an episode. Where `count` is larger, each further AUV
    #: starts in the cell farthest, counted in cells, from all starts before it (of equals the
    #: first in x, y, z).
    start_cells: Annotated[tuple[Cell, ...], Field(min_length=1, max_length=MAX_AUVS, strict=False)]
    #: Number of AUVs; null for one at each start cell. A scenario that lists start cells over
    #: one that counts AUVs means one at each of its own.
    count: Annotated[Count, Field(le=MAX_AUVS), Plausible(1, 100, "AUVs")] | None = None
    #: Speed of every AUV: with the longest edge of a cell it gives the length of a slot, in
    #: which a step along a shorter edge is made more slowly, unless `episode.slot_s` does.
    speed_m_per_s: Annotated[Positive, Plausible(0.001, 30, "m/s")]
    #: The directions that an AUV can take. In a grid of one cell every direction stays.
    motion: Annotated[Settings, PartOf("motion", is_word=True)] = Field(
        "six", validate_default=True
    )
    #: Distance in cells that any two AUVs keep; 1 keeps them in cells of their own, 0 sets
    #: no rule. Of AUVs whose moves would end too near one another, or swap their cells,
    #: all stay where they are.
    separation_cells: Annotated[NonNegative, Plausible(0, 1000, "cells")] = 1.0
    #: Whether an AUV may charge nobody and hear nobody: one more choice, behind all nodes.
    idle_choices: bool = False

    hash_defaults: ClassVar[dict[str, Any]] = {"separation_cells": 1.0, "idle_choices": False}


class Episode(Section):
    """How long an episode takes."""

    #: Navigation time T; an episode has as many slots as fit in it.
    duration_s: Annotated[Positive, Plausible(0.01, 1e8, "s")]
    #: Length of a slot τ; null for the time that the AUV takes for the longest edge of a cell. With
    #: one of its own a move may take several slots, or cover several cells in one.
    slot_s: Annotated[Positive, Plausible(0.001, 1e5, "s")] | None = None

    hash_defaults: ClassVar[dict[str, Any]] = {"slot_s": None}


class Charging(Section):
    """The acoustic source of an AUV."""

    #: Electric power of the source.
    power_w: Annotated[Positive, Plausible(0, 1e6, "W")]
    #: Share of the electric power that becomes sound.
    efficiency: Efficiency
    #: Directivity index of the source: how much louder it is in the direction of the node.
    directivity_index_db: Directivity


class Age(Section):
    """Age of Information, in slots."""

    #: Age of every node when an episode begins.
    initial: Slots = 1
    #: A_max: ages stop here, and each slot in which one would pass it is a violation.
    maximum: Slots = 50
    #: When the data of a packet are from: `slot_end` makes a node that delivers 1 slot old at the
    #: end of the slot, where ages are read; by `packet_start` it is as old as the packet, and mean
    #: ages are over time.
    sampling: Literal["slot_end", "packet_start"] = "slot_end"

    hash_defaults: ClassVar[dict[str, Any]] = {"sampling": "slot_end"}

    @property
    def is_continuous(self) -> bool:
        """Whether ages are read at all times, and are no whole slots."""
        return self.sampling == "packet_start"

    @property
    def least(self) -> float:
        """What no age is below, in slots."""
        return 0.0 if self.is_continuous else 1.0

    @model_validator(mode="after")
    def _initial_within_maximum(self) -> Self:
        if self.initial > self.maximum:
            raise invalid(
                ("initial",),
                f"must not exceed age.maximum, {self.maximum}",
                beside=("age", "maximum"),
            )
        return self


class Fairness(Section):
    """What an episode's fairness is measured against."""

    #: J_min: an episode that ends below it is a violation.
    minimum_jain: Fraction = 0.85
