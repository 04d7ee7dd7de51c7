"""What a scenario file may say as a whole, and what of it must fit together."""

from __future__ import annotations

import hashlib
import json
import math
from typing import Annotated, Literal, Self

from pydantic import Field, field_validator, model_validator

from iout_marl.scenario.fields import Count, NonNegative, Positive, Section, invalid
from iout_marl.scenario.sections import (
    Age,
    Auvs,
    Charging,
    Episode,
    Fairness,
    Fdd,
    FixedNodes,
    Grid,
    Harvester,
    MeanAgeReward,
    Observation,
    PaperChannel,
    PaperReward,
    RandomNodes,
    SonarChannel,
    Tdd,
    Uplink,
)
from iout_marl.scenario.starts import spread_starts

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
    #: Forbid what is useless (leaving the grid, hearing a node that cannot pay).
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
        separation = self.auvs.separation_cells
        placed = len(spread_starts(starts, self.num_auvs, self.grid.cells, separation))
        if placed < self.num_auvs:
            raise invalid(
                ("auvs", "count"),
                f"is {self.num_auvs}, but only {placed} AUVs find room at "
                f"auvs.separation_cells, {separation:g}",
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
