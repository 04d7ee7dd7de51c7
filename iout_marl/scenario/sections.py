"""The sections of a scenario file but for its training: every key, its unit, its range.

Units stand in the names of the fields. Cells are counted from 1, as in the paper.
Sections with a `kind` are parts: each kind has keys of its own.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self, TypeAlias

from pydantic import Field, model_validator

from iout_marl.scenario.fields import (
    Cell,
    Count,
    Decibels,
    Efficiency,
    Fraction,
    NonNegative,
    Plausible,
    Positive,
    Real,
    Section,
    invalid,
)

#: More than the arrays of a world have room for.
MAX_NODES, MAX_AUVS = 4_000, 1_000

Frequency: TypeAlias = Annotated[Positive, Plausible(0.1, 1000, "kHz", slips=(1e-3,))]
Directivity: TypeAlias = Annotated[Decibels, Plausible(-30, 60, "dB")]
Spreading: TypeAlias = Annotated[float, Field(ge=0, le=4)]
Weights: TypeAlias = Annotated[
    tuple[Annotated[NonNegative, Plausible(0, 1e6)], ...],
    Field(strict=False, max_length=MAX_NODES),
]
NumNodes: TypeAlias = Annotated[Count, Field(le=MAX_NODES), Plausible(1, 1000, "nodes")]
#: What is added to a reward or multiplies an age in it.
Term: TypeAlias = Annotated[Real, Plausible(-1e6, 1e6)]
Slots: TypeAlias = Annotated[Count, Plausible(1, 1_000_000, "slots")]


class Grid(Section):
    """The water, cut into cubic cells."""

    #: Cells along x, y and z.
    cells: Annotated[Cell, Plausible(1, 1000, "cells")]
    #: Edge of a cell in m; one slot is the time the AUV takes for it.
    spacing_m: Annotated[Positive, Plausible(0.01, 10_000, "m")]


class FixedNodes(Section):
    """Nodes at given cells."""

    kind: Literal["fixed"] = "fixed"
    cells: Annotated[tuple[Cell, ...], Field(min_length=1, max_length=MAX_NODES, strict=False)]
    #: How many of `cells` hold a node, from the first on; null for all. A scenario that lists
    #: cells over one that counts them means all of its own.
    count: NumNodes | None = None
    #: Importance δ_k of each node; null for 1 each.
    weights: Weights | None = None


class RandomNodes(Section):
    """Nodes at cells drawn at random, no two in one cell."""

    kind: Literal["random"] = "random"
    count: NumNodes
    #: Draw anew for every episode, or once for a run (from the run's seed).
    redraw: Literal["run", "episode"] = "episode"
    #: Importance δ_k of each node; null for 1 each.
    weights: Weights | None = None


class Auvs(Section):
    """The vehicles."""

    #: Cell in which each AUV starts an episode. Where `count` is larger, each further AUV
    #: starts in the cell farthest from all starts before it (of equals the first in x, y, z).
    start_cells: Annotated[tuple[Cell, ...], Field(min_length=1, max_length=MAX_AUVS, strict=False)]
    #: Number of AUVs; null for one at each start cell. A scenario that lists start cells over
    #: one that counts AUVs means one at each of its own.
    count: Annotated[Count, Field(le=MAX_AUVS), Plausible(1, 100, "AUVs")] | None = None
    speed_m_per_s: Annotated[Positive, Plausible(0.001, 30, "m/s")]
    #: `six`: one cell along an axis in every slot, never at rest; `hover`: a seventh
    #: direction stays where the AUV is. In a grid of one cell every direction stays.
    motion: Literal["six", "hover"] = "six"
    #: Distance in cells that any two AUVs keep; 1 keeps them in cells of their own, 0 sets
    #: no rule. Of AUVs whose moves would end too near one another, or swap their cells,
    #: all stay where they are.
    separation_cells: Annotated[NonNegative, Plausible(0, 1000, "cells")] = 1.0


class Episode(Section):
    #: Navigation time T; an episode has as many slots as fit in it.
    duration_s: Annotated[Positive, Plausible(0.01, 1e8, "s")]


class Thorp(Section):
    kind: Literal["thorp"] = "thorp"


class FrancoisGarrison(Section):
    kind: Literal["francois_garrison"] = "francois_garrison"
    temperature_c: Annotated[float, Field(ge=-2, le=40)] = 10.0
    salinity_psu: Annotated[float, Field(gt=0, le=50)] = 35.0
    depth_m: Annotated[float, Field(ge=0, le=11000)] = 200.0
    ph: Annotated[float, Field(ge=6, le=9)] = 8.0


Absorption: TypeAlias = Annotated[Thorp | FrancoisGarrison, Field(discriminator="kind")]


class SharedChannel(Section):
    """How several AUVs share the uplink's band; one AUV has it to itself in every kind.

    `orthogonal`: the band is divided evenly among the AUVs. `interference`: all share it,
    every node sends with the least power that meets its SNR against noise and the other
    uplinks, and where there are no such powers the weakest links stay silent.
    `exclusive`: one uplink a slot in the whole network; two or more collide, and all fail.
    """

    access: Literal["orthogonal", "interference", "exclusive"] = "orthogonal"


class PaperChannel(SharedChannel):
    """Levels as the paper computes them.

    `table` attenuates by k_s log₁₀ d + α d, the form behind the paper's tables and
    results; `equation` by 10 k_s log₁₀ d + α d, its eq. `AL` as printed.
    """

    kind: Literal["table", "equation"] = "table"
    spreading_factor: Spreading = 1.5
    #: NL, subtracted from the energy signal too.
    noise_level_db: Annotated[Decibels, Plausible(-20, 200, "dB re 1 µPa")] = 30.0
    absorption: Absorption = Thorp()


class SonarChannel(SharedChannel):
    """Consistent units: the sonar equation, ambient noise in the uplink's band."""

    kind: Literal["sonar"] = "sonar"
    spreading_factor: Spreading = 1.5
    absorption: Absorption = Thorp()
    #: Shipping activity of Wenz's noise, from 0 to 1.
    shipping: Fraction = 0.5
    wind_m_per_s: Annotated[NonNegative, Field(le=1000), Plausible(0, 100, "m/s")] = 0.0
    #: Electro-acoustic efficiency of a node's transmitter.
    uplink_efficiency: Efficiency = 0.5
    uplink_directivity_index_db: Directivity = 0.0


class Charging(Section):
    """The acoustic source of an AUV."""

    power_w: Annotated[Positive, Plausible(0, 1e6, "W")]
    efficiency: Efficiency
    directivity_index_db: Directivity


class Harvester(Section):
    """The receiver with which a node harvests."""

    #: Receiving voltage sensitivity in dB re 1 V/µPa.
    sensitivity_db: Annotated[Decibels, Plausible(-260, -100, "dB re 1 V/µPa", slips=(-1, 10))]
    efficiency: Efficiency
    hydrophones: Annotated[Count, Field(le=10**6), Plausible(1, 1000, "hydrophones")]
    load_resistance_ohm: Annotated[Positive, Plausible(0.01, 1e9, "Ω")]


class Uplink(Section):
    packet_bits: Annotated[Positive, Plausible(1, 1e9, "bit")]
    bandwidth_hz: Annotated[Positive, Plausible(10, 1e6, "Hz", slips=(1e3,))]


class Fdd(Section):
    """Charging and uplink at once, in two bands, of any two nodes."""

    kind: Literal["fdd"] = "fdd"
    charging_frequency_khz: Frequency = 40.0
    uplink_frequency_khz: Frequency = 30.0


class Tdd(Section):
    """One band and one node a slot: charging for βτ, uplink for (1 − β)τ.

    `paper`: β is the root in [β_min, β_max] at which E_harv(β) rises to E_req(β);
    without a root 0 where the stored energy pays the uplink, else 1. `stored`: the smallest β of
    {0} ∪ [β_min, β_max] for which stored and harvested energy pay it, else 1.
    """

    kind: Literal["tdd"] = "tdd"
    frequency_khz: Frequency = 40.0
    beta_rule: Literal["paper", "stored"] = "paper"
    beta_min: Fraction = 0.1
    beta_max: Fraction = 0.9
    #: Whether the AUVs charge at the same time; if not, one that charges disturbs those that
    #: listen (`channel.access: interference`).
    synchronised: bool = False

    @model_validator(mode="after")
    def _bounds_in_order(self) -> Self:
        if not self.beta_min < self.beta_max < 1:
            raise invalid(
                ("beta_min",),
                f"the bounds must satisfy beta_min < beta_max < 1, "
                f"not {self.beta_min:g} and {self.beta_max:g}",
            )
        return self


class Age(Section):
    """Age of Information, in slots."""

    initial: Slots = 1
    #: A_max: ages stop here, and each slot in which one would pass it is a violation.
    maximum: Slots = 50

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
    #: J_min: an episode that ends below it is a violation.
    minimum_jain: Fraction = 0.85


#: Whom the network's age term is credited to. `team`: every AUV gets it. `difference`: every AUV
#: gets what it has added (Wolpert and Tumer, 2001): the term less what it would be had no packet
#: ever reached this AUV, all else alike.
Credit: TypeAlias = Literal["team", "difference"]


class PaperReward(Section):
    """r = −(w 𝒟/K Σ δ_k A_k + penalties), eq. `reward function`.

    Penalties are subtracted: a negative one is a bonus.
    """

    kind: Literal["paper"] = "paper"
    #: w, a factor on the discriminated age; the paper's is 1.
    age_weight: Term = 1.0
    #: A move out of the grid.
    location_penalty: Term = 10.0
    #: A move that came too near another AUV's (see `auvs.separation_cells`).
    separation_penalty: Term = 10.0
    #: FDD: the uplink failed, and no node could have paid one.
    no_able_node_penalty: Term = 4.0
    #: FDD: the uplink failed, and another node could have paid one.
    wrong_node_penalty: Term = 4.0
    #: TDD: β = 1.
    only_charging_penalty: Term = 4.0
    #: TDD: β = 0.
    only_transmitting_penalty: Term = 0.0
    #: Data taken from a node that was served more than T/K times.
    occurrence_penalty: Term = 10.0
    #: Each node not served so far in the episode, in every slot.
    unserved_penalty: Term = 0.0
    credit: Credit = "team"


class MeanAgeReward(Section):
    """r = −((1/K) Σ δ_k A_k + w (1 − J))."""

    kind: Literal["mean_age"] = "mean_age"
    #: w, in slots of mean age: what fairness is worth. Where the paper multiplies, this adds.
    fairness_weight: Annotated[NonNegative, Plausible(0, 1e6, "slots")] = 0.0
    credit: Credit = "team"


class Observation(Section):
    """What an AUV sees: its position, the ages and the stored energies of the nodes.

    `paper` in cells, slots and joules; `scaled` the same in [0, 1], energies by
    e/(e + price), where the price is that of an uplink over half the grid.
    """

    kind: Literal["paper", "scaled"] = "paper"
    #: Append the positions of the nodes, for layouts that change.
    node_positions: bool = False
    #: Append the share of the episode that is over.
    time: bool = False
    #: Append where the other AUVs are, relative to the own position, the nearest first.
    other_auvs: bool = True
    #: Append which AUV this is, as M entries of which one is 1.
    agent_index: bool = False
    #: Distance up to which an AUV knows a node's age and energy; those of a node farther away
    #: are what they were when it last was near or delivered to this AUV, and how many slots
    #: ago that was is appended. null: everything is known to all.
    view_range_m: Annotated[Positive, Plausible(0, 1e7, "m")] | None = None
    #: Where the mask of sensible actions is handed out, if at all.
    action_mask: Literal["none", "info", "observation"] = "none"
