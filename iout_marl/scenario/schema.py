"""What a scenario file may say: every key, its unit, its range.

Units stand in the names of the fields. Cells are counted from 1, as in the paper.
Sections with a `kind` are parts: each kind has keys of its own.
"""

from __future__ import annotations

import hashlib
import json
import math
from typing import Annotated, Any, Literal, Self, TypeAlias

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator
from pydantic_core import PydanticCustomError

from iout_marl.errors import did_you_mean

Positive: TypeAlias = Annotated[float, Field(gt=0)]
NonNegative: TypeAlias = Annotated[float, Field(ge=0)]
Fraction: TypeAlias = Annotated[float, Field(ge=0, le=1)]
Count: TypeAlias = Annotated[int, Field(ge=1, le=10**12)]
Cell: TypeAlias = Annotated[tuple[Count, Count, Count], Field(strict=False)]


def invalid(path: tuple[str | int, ...], message: str) -> PydanticCustomError:
    """An error at `path` below the model that raises it."""
    # The message is data, not a template: braces in it must not be filled in.
    return PydanticCustomError("invalid", "{message}", {"message": message, "path": path})


#: Keys that came after hashes had been published, with the values that stand for how it was
#: before: those leave the hash as it was.
_CAME_LATER = (
    ("auvs", "separation_cells", 1.0),
    ("channel", "access", "orthogonal"),
    ("duplex", "synchronised", False),
    ("observation", "agent_index", False),
    ("observation", "other_auvs", True),
    ("observation", "view_range_m", None),
    ("reward", "credit", "team"),
    ("reward", "fairness_weight", 0.0),
    ("reward", "separation_penalty", 10.0),
    ("training", "critic", "own"),
    ("training", "node_network", False),
)


class Section(BaseModel):
    """A section of a scenario: immutable, strictly typed, without unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown_keys(cls, data: Any) -> Any:
        if isinstance(data, dict):
            for key in data:
                if key not in cls.model_fields:
                    hint = did_you_mean(str(key), cls.model_fields)
                    raise invalid((key,), f"unknown key{hint}")
        return data


class Grid(Section):
    """The water, cut into cubic cells."""

    #: Cells along x, y and z.
    cells: Cell
    #: Edge of a cell in m; one slot is the time the AUV takes for it.
    spacing_m: Positive


class FixedNodes(Section):
    """Nodes at given cells."""

    kind: Literal["fixed"] = "fixed"
    cells: Annotated[tuple[Cell, ...], Field(min_length=1, strict=False)]
    #: How many of `cells` hold a node, from the first on; null for all.
    count: Count | None = None
    #: Importance δ_k of each node; null for 1 each.
    weights: Annotated[tuple[NonNegative, ...], Field(strict=False)] | None = None


class RandomNodes(Section):
    """Nodes at cells drawn at random, no two in one cell."""

    kind: Literal["random"] = "random"
    count: Count
    #: Draw anew for every episode, or once for a run (from the run's seed).
    redraw: Literal["run", "episode"] = "episode"
    #: Importance δ_k of each node; null for 1 each.
    weights: Annotated[tuple[NonNegative, ...], Field(strict=False)] | None = None


class Auvs(Section):
    """The vehicles."""

    #: Cell in which each AUV starts an episode. Where `count` is larger, each further AUV
    #: starts in the cell farthest from all starts before it (of equals the first in x, y, z).
    start_cells: Annotated[tuple[Cell, ...], Field(min_length=1, strict=False)]
    #: Number of AUVs; null for one at each start cell.
    count: Count | None = None
    speed_m_per_s: Positive
    #: `six`: one cell along an axis in every slot, never at rest; `hover`: a seventh
    #: direction stays where the AUV is.
    motion: Literal["six", "hover"] = "six"
    #: Distance in cells that any two AUVs keep; 1 keeps them in cells of their own, 0 sets
    #: no rule. Of AUVs whose moves would end too near one another, or swap their cells,
    #: all stay where they are.
    separation_cells: NonNegative = 1.0


class Episode(Section):
    #: Navigation time T; an episode has as many slots as fit in it.
    duration_s: Positive


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
    """Levels as the paper reckons them.

    `table` attenuates by k_s log₁₀ d + α d, the form behind the paper's tables and
    results; `equation` by 10 k_s log₁₀ d + α d, its eq. `AL` as printed.
    """

    kind: Literal["table", "equation"] = "table"
    spreading_factor: Annotated[float, Field(ge=0, le=4)] = 1.5
    #: NL, subtracted from the energy signal too.
    noise_level_db: float = 30.0
    absorption: Absorption = Thorp()


class SonarChannel(SharedChannel):
    """Consistent units: the sonar equation, ambient noise in the uplink's band."""

    kind: Literal["sonar"] = "sonar"
    spreading_factor: Annotated[float, Field(ge=0, le=4)] = 1.5
    absorption: Absorption = Thorp()
    #: Shipping activity of Wenz's noise, from 0 to 1.
    shipping: Fraction = 0.5
    wind_m_per_s: NonNegative = 0.0
    #: Electro-acoustic efficiency of a node's transmitter.
    uplink_efficiency: Annotated[float, Field(gt=0, le=1)] = 0.5
    uplink_directivity_index_db: float = 0.0


class Charging(Section):
    """The acoustic source of an AUV."""

    power_w: Positive
    efficiency: Annotated[float, Field(gt=0, le=1)]
    directivity_index_db: float


class Harvester(Section):
    """The receiver with which a node harvests."""

    #: Receiving voltage sensitivity in dB re 1 V/µPa.
    sensitivity_db: float
    efficiency: Annotated[float, Field(gt=0, le=1)]
    hydrophones: Count
    load_resistance_ohm: Positive


class Uplink(Section):
    packet_bits: Positive
    bandwidth_hz: Positive


class Fdd(Section):
    """Charging and uplink at once, in two bands, of any two nodes."""

    kind: Literal["fdd"] = "fdd"
    charging_frequency_khz: Positive = 40.0
    uplink_frequency_khz: Positive = 30.0


class Tdd(Section):
    """One band and one node a slot: charging for βτ, uplink for (1 − β)τ.

    `paper`: β is the root in [β_min, β_max] at which E_harv(β) rises to E_req(β);
    without a root 0 where the stored energy pays the uplink, else 1. `stored`: the smallest β of
    {0} ∪ [β_min, β_max] for which stored and harvested energy pay it, else 1.
    """

    kind: Literal["tdd"] = "tdd"
    frequency_khz: Positive = 40.0
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

    initial: Count = 1
    #: A_max: ages stop here, and each slot in which one would pass it is a violation.
    maximum: Count = 50

    @model_validator(mode="after")
    def _initial_within_maximum(self) -> Self:
        if self.initial > self.maximum:
            raise invalid(("initial",), f"must not exceed age.maximum, {self.maximum}")
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
    age_weight: float = 1.0
    #: A move out of the grid.
    location_penalty: float = 10.0
    #: A move that came too near another AUV's (see `auvs.separation_cells`).
    separation_penalty: float = 10.0
    #: FDD: the uplink failed, and no node could have paid one.
    no_able_node_penalty: float = 4.0
    #: FDD: the uplink failed, and another node could have paid one.
    wrong_node_penalty: float = 4.0
    #: TDD: β = 1.
    only_charging_penalty: float = 4.0
    #: TDD: β = 0.
    only_transmitting_penalty: float = 0.0
    #: Data taken from a node that was served more than T/K times.
    occurrence_penalty: float = 10.0
    #: Each node not served so far in the episode, in every slot.
    unserved_penalty: float = 0.0
    credit: Credit = "team"


class MeanAgeReward(Section):
    """r = −((1/K) Σ δ_k A_k + w (1 − J))."""

    kind: Literal["mean_age"] = "mean_age"
    #: w, in slots of mean age: what fairness is worth. Where the paper multiplies, this adds.
    fairness_weight: NonNegative = 0.0
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
    view_range_m: Positive | None = None
    #: Where the mask of sensible actions is handed out, if at all.
    action_mask: Literal["none", "info", "observation"] = "none"


class Training(Section):
    """Settings of PPO. `preset` names the file that gives whatever is not given here."""

    preset: str
    #: Environment steps (one slot of one environment) to train for.
    steps: Count
    environments: Count
    #: Slots of each environment between two updates.
    rollout_slots: Count
    #: Passes over a rollout.
    epochs: Count
    #: Parts into which a rollout is cut in each epoch.
    minibatches: Count
    learning_rate: Positive
    #: `linear` falls to 0 over the training.
    learning_rate_schedule: Literal["constant", "linear"]
    adam_epsilon: Positive
    discount: Annotated[float, Field(ge=0, le=1)]
    gae_lambda: Annotated[float, Field(ge=0, le=1)]
    clip: Positive
    entropy_coefficient: NonNegative
    value_coefficient: NonNegative
    max_gradient_norm: Positive
    normalise_advantage: bool
    #: Let the critic work on returns of mean 0 and spread 1 (PopArt).
    normalise_value: bool
    #: Leave the epochs of an update once the policy has moved this far; null for never.
    target_kl: Positive | None
    hidden_units: Annotated[tuple[Count, ...], Field(min_length=1, strict=False)]
    activation: Literal["tanh", "relu"]
    #: What the critic sees: `own`, the AUV's observation (IPPO), or `central`, the state of the
    #: whole network beside it (MAPPO). With difference rewards it also sees what they are made
    #: of. AUVs share one actor and one critic in either.
    critic: Literal["own", "central"] = "own"
    #: Add to the actor's score of every node what a small network, the same for all nodes, makes
    #: of its age and energy: for many nodes.
    node_network: bool = False
    #: Inputs of the networks: `none`, `fixed` (by the observation's ranges) or
    #: `running` (by mean and spread of what was seen).
    observation_scaling: Literal["none", "fixed", "running"]
    #: Divisor of the rewards: `none`, `first_rollout` (their spread in it) or
    #: `running` (the spread of the discounted return so far).
    reward_scaling: Literal["none", "first_rollout", "running"]
    #: Forbid what is useless (leaving the grid, hearing a node that can not pay).
    mask_actions: bool
    #: Environment steps between two checkpoints.
    checkpoint_steps: Count


class Scenario(Section):
    """A scenario, complete: whatever changes a result stands in it."""

    #: What the scenario is called; not part of its hash.
    name: str = "unnamed"
    description: str = ""
    grid: Grid
    nodes: Annotated[FixedNodes | RandomNodes, Field(discriminator="kind")]
    auvs: Auvs
    episode: Episode
    channel: Annotated[PaperChannel | SonarChannel, Field(discriminator="kind")]
    charging: Charging
    harvester: Harvester
    uplink: Uplink
    duplex: Annotated[Fdd | Tdd, Field(discriminator="kind")]
    age: Age = Age()
    fairness: Fairness = Fairness()
    reward: Annotated[PaperReward | MeanAgeReward, Field(discriminator="kind")]
    observation: Observation = Observation()
    training: Training

    @field_validator("name", "description")
    @classmethod
    def _can_be_written(cls, text: str) -> str:
        if any("\ud800" <= c <= "\udfff" for c in text):
            raise invalid((), "holds half a character, such as \\ud800")
        return text

    @model_validator(mode="after")
    def _check_across_sections(self) -> Self:
        self._check_nodes()
        self._check_starts()
        if self.episode.duration_s < self.slot_s:
            raise invalid(
                ("episode", "duration_s"), f"must hold at least one slot of {self.slot_s:g} s"
            )
        if self.slot_s == 0 or math.isinf(self.episode.duration_s / self.slot_s):
            raise invalid(("grid", "spacing_m"), "makes slots too short to be counted")
        self._check_uplink_band()
        samples = self.training.environments * self.training.rollout_slots * self.num_auvs
        if samples < 2:
            raise invalid(("training", "rollout_slots"), "must give a rollout of 2 samples or more")
        if self.training.minibatches > samples:
            raise invalid(
                ("training", "minibatches"),
                f"must not exceed the {samples} samples of a rollout",
            )
        return self

    def _check_cell(self, path: tuple[str | int, ...], cell: tuple[int, int, int]) -> None:
        if any(c > size for c, size in zip(cell, self.grid.cells, strict=True)):
            size = " × ".join(map(str, self.grid.cells))
            raise invalid(path, f"cell {list(cell)} lies outside the grid of {size} cells")

    def _check_nodes(self) -> None:
        nodes = self.nodes
        if isinstance(nodes, FixedNodes):
            for i, cell in enumerate(nodes.cells):
                self._check_cell(("nodes", "cells", i), cell)
            if nodes.count is not None and nodes.count > len(nodes.cells):
                raise invalid(
                    ("nodes", "count"),
                    f"is {nodes.count}, but nodes.cells lists only {len(nodes.cells)} cells",
                )
        elif nodes.count > math.prod(self.grid.cells):
            raise invalid(
                ("nodes", "count"),
                f"is {nodes.count}, but the grid has only {math.prod(self.grid.cells)} cells",
            )
        if nodes.weights is not None and len(nodes.weights) != self.num_nodes:
            raise invalid(
                ("nodes", "weights"),
                f"must list one weight for each of the {self.num_nodes} nodes, "
                f"not {len(nodes.weights)}",
            )

    def _check_starts(self) -> None:
        starts = self.auvs.start_cells
        for i, cell in enumerate(starts):
            self._check_cell(("auvs", "start_cells", i), cell)
            if cell in starts[:i]:
                raise invalid(
                    ("auvs", "start_cells", i),
                    f"cell {list(cell)} is the start of two AUVs; each needs one of its own",
                )
            for other in starts[: min(i, self.num_auvs)]:
                if i < self.num_auvs and math.dist(cell, other) < self.auvs.separation_cells:
                    raise invalid(
                        ("auvs", "start_cells", i),
                        f"cell {list(cell)} lies nearer to {list(other)} than "
                        f"auvs.separation_cells, {self.auvs.separation_cells:g}",
                    )
        if self.num_auvs > math.prod(self.grid.cells):
            raise invalid(
                ("auvs", "count"),
                f"is {self.num_auvs}, but the grid has only {math.prod(self.grid.cells)} cells: "
                "each AUV starts in one of its own",
            )

    def _check_uplink_band(self) -> None:
        if self.channel.kind != "sonar":
            return
        frequency_khz = (
            self.duplex.uplink_frequency_khz
            if isinstance(self.duplex, Fdd)
            else self.duplex.frequency_khz
        )
        if self.uplink.bandwidth_hz >= 2e3 * frequency_khz:
            raise invalid(
                ("uplink", "bandwidth_hz"),
                f"the band around {frequency_khz:g} kHz must stay above 0 Hz",
            )

    @property
    def num_nodes(self) -> int:
        """K."""
        if isinstance(self.nodes, FixedNodes) and self.nodes.count is None:
            return len(self.nodes.cells)
        assert self.nodes.count is not None
        return self.nodes.count

    @property
    def num_auvs(self) -> int:
        """M."""
        return self.auvs.count or len(self.auvs.start_cells)

    @property
    def slot_s(self) -> float:
        """τ in s: the time the AUV takes for one cell."""
        return self.grid.spacing_m / self.auvs.speed_m_per_s

    @property
    def num_slots(self) -> int:
        """Slots of an episode."""
        # A quotient such as 0.3/0.1 falls short of its whole number by a rounding.
        return math.floor(self.episode.duration_s / self.slot_s * (1 + 1e-12))

    @property
    def node_weights(self) -> tuple[float, ...]:
        """δ_k of every node."""
        return self.nodes.weights or (1.0,) * self.num_nodes

    @property
    def hash(self) -> str:
        """12 hexadecimal digits that change with whatever changes a result."""
        return self._digest()

    @property
    def world_hash(self) -> str:
        """As `hash`, of the world alone: without the reward and the training settings."""
        return self._digest("reward", "training")

    def _digest(self, *without: str) -> str:
        text = self.model_dump_json(exclude={"name", "description", *without})
        # Adding 0 makes −0.0, which equals 0.0, the same in writing too.
        data = json.loads(text, parse_float=lambda number: float(number) + 0.0)
        for section, key, value in _CAME_LATER:
            if data.get(section, {}).get(key) == value:
                del data[section][key]
        text = json.dumps(data, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:12]
