"""What a study's file may say."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, TypeAlias

from pydantic import AfterValidator, Field, model_validator

from iout_marl import policies
from iout_marl.bounds import DEFAULT_SECONDS
from iout_marl.errors import InputError, did_you_mean
from iout_marl.policies import PlannerPolicy
from iout_marl.report.registry import report_named
from iout_marl.scenario.fields import Count, Section, invalid
from iout_marl.scenario.layers import Layer, read_file
from iout_marl.scenario.problems import validate
from iout_marl.scenario.sources import find_study
from iout_marl.study.fields import Text, Words

#: The policy that is trained, by the scenario's `training` section.
TRAINED = "ppo"
#: The policy that searches as long as it may.
PLANNER = PlannerPolicy.name
#: What stands where a policy does, and is the mean AoI that none can beat.
BOUND = "bound"
POLICIES = (*policies.POLICIES, TRAINED, BOUND)

Settings: TypeAlias = dict[str, Any]
Seed: TypeAlias = Annotated[int, Field(ge=0, lt=2**63)]
#: A cell plays all of its episodes at once.
Episodes: TypeAlias = Annotated[int, Field(ge=1, le=100_000)]
#: How long searches may take: so many rounds, so many seconds (four months).
Rounds: TypeAlias = Annotated[int, Field(ge=0, le=10**9)]
Seconds: TypeAlias = Annotated[float, Field(ge=0, le=1e7)]


def _registered(report: str) -> str:
    try:
        report_named(report)
    except InputError as error:
        raise invalid((), str(error)) from None
    return report


#: The name of a report: `plain` shows every series over the axis, `paper` answers the paper's
#: claims; others are registered by users.
Report: TypeAlias = Annotated[Words, AfterValidator(_registered)]


def _as_is() -> dict[str, Settings]:
    """One variant without a name, that changes nothing."""
    return {"": {}}


class Axis(Section):
    """What the figures are drawn over."""

    #: A key of the scenario, in dots, whose value is a number.
    key: Words = "nodes.count"
    label: Words = "Number of nodes K"


class Quick(Section):
    """What `--quick` leaves of the study."""

    #: The values of the axis; null for all.
    axis: Annotated[tuple[float, ...], Field(min_length=1, strict=False)] | None = None
    #: How many seeds of each group, from its first.
    seeds: Count | None = None
    #: What searches take, in every group: rounds of the planner, seconds for a bound.
    planner_rounds: Rounds | None = None
    bound_seconds: Seconds | None = None
    #: Groups that are left out.
    without: Annotated[tuple[str, ...], Field(strict=False)] = ()
    #: Dotted keys over those of every group.
    settings: Settings = Field(default_factory=dict)


class Group(Section):
    """A grid of cells: scenarios × variants × grid × policies × seeds."""

    #: What the report calls them, `{policy}`, `{variant}` and the keys of `grid` filled in.
    series: Words = "{policy}"
    scenarios: Annotated[tuple[str, ...], Field(min_length=1, strict=False)]
    policies: Annotated[tuple[str, ...], Field(min_length=1, strict=False)]
    seeds: Annotated[tuple[Seed, ...], Field(min_length=1, strict=False)] = (0,)
    #: Episodes in which each policy is evaluated; a bound has one figure.
    episodes: Episodes = 100
    #: How long the planner searches: so many rounds for all episodes together; null for the
    #: usual few.
    planner_rounds: Rounds | None = None
    #: How long a bound is searched for, about.
    bound_seconds: Seconds = DEFAULT_SECONDS
    #: Dotted keys over every scenario.
    settings: Settings = Field(default_factory=dict)
    #: Dotted keys over every scenario, by the name of the variant.
    variants: Annotated[dict[Words, Settings], Field(min_length=1)] = Field(default_factory=_as_is)
    #: Values of dotted keys, every combination of which is a cell.
    grid: dict[str, list[Any]] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _check(self) -> Group:
        for i, policy in enumerate(self.policies):
            # One of MODULE:NAME is looked for among those that the command line names.
            if policy not in POLICIES and ":" not in policy:
                hint = did_you_mean(policy, POLICIES)
                raise invalid(("policies", i), f"unknown policy {policy!r}{hint}")
        for key, policy in (("planner_rounds", PLANNER), ("bound_seconds", BOUND)):
            if key in self.model_fields_set and policy not in self.policies:
                raise invalid((key,), f"there is no {policy!r} among the group's policies")
        for key, values in self.grid.items():
            if not values:
                raise invalid(("grid", key), "is empty: give at least one value")
        for name in ("policies", "seeds"):
            if len(set(getattr(self, name))) < len(getattr(self, name)):
                raise invalid((name,), "lists the same value twice")
        return self


class Study(Section):
    """A study: groups of cells, and how they are reported."""

    title: Words
    description: Text = ""
    report: Report = "plain"
    axis: Axis = Axis()
    #: Show mean AoI against fairness, and the Pareto front of each world.
    front: bool = False
    quick: Quick = Quick()
    #: Carbon intensity of the electricity, in g of CO2 for a kWh; codecarbon's of the world.
    carbon_g_per_kwh: Annotated[float, Field(ge=0, le=1e6)] = 475.0
    groups: Annotated[dict[Words, Group], Field(min_length=1)]

    @model_validator(mode="after")
    def _leave_out_what_is_there(self) -> Study:
        for i, name in enumerate(self.quick.without):
            if name not in self.groups:
                hint = did_you_mean(name, self.groups)
                raise invalid(("quick", "without", i), f"unknown group {name!r}{hint}")
        return self


def load_study(source: str | Path) -> tuple[Study, Layer]:
    """Load and check a study.

    Args:
        source: the name of a bundled study, or a path to a YAML file.

    Returns:
        the study, and the layer that knows where each of its keys was written.

    Raises:
        InputError: one line with file, line, key and what was meant.
    """
    layer = read_file(find_study(source))
    return validate(Study, layer), layer
