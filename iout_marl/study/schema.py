"""What a study's file may say."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Self, TypeAlias

from pydantic import AfterValidator, Field, model_validator

from iout_marl import policies
from iout_marl.bounds import DEFAULT_SECONDS
from iout_marl.errors import InputError, did_you_mean
from iout_marl.policies import PlannerPolicy
from iout_marl.report.registry import report_named
from iout_marl.scenario.bases import is_scenario
from iout_marl.scenario.fields import Count, Section, invalid
from iout_marl.scenario.layers import Layer, read_file
from iout_marl.scenario.places import show_file
from iout_marl.scenario.problems import validate
from iout_marl.scenario.sources import find_study
from iout_marl.study.fields import Text, Words
from iout_marl.words import place_text

#: The policy that is trained, by the scenario's `training` section.
TRAINED = "ppo"
#: The policy that searches as long as it may.
PLANNER = PlannerPolicy.name
#: What stands where a policy does, and is the mean AoI that none can beat.
BOUND = "bound"
POLICIES = (*policies.POLICIES, TRAINED, BOUND)

#: Variants on an axis that a figure has room for.
MAX_VARIANTS = 100

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
    """What the figures are drawn over: a key of the scenario, or variants."""

    #: A key of the scenario, in dots, whose value is a number.
    key: Words = "nodes.count"
    label: Words = "Number of nodes K"
    #: In place of a key: names of variants, in this order. Every group has all its variants here.
    variants: Annotated[tuple[Words, ...], Field(max_length=MAX_VARIANTS, strict=False)] = ()

    @model_validator(mode="before")
    @classmethod
    def _label_variants(cls, data: Any) -> Any:
        if isinstance(data, dict) and data.get("variants"):
            return {"label": "Variant", **data}
        return data

    @model_validator(mode="after")
    def _is_one_of_both(self) -> Self:
        if self.variants and self.key != type(self).model_fields["key"].default:
            raise invalid(("variants",), "is given beside key: the axis is one of the two")
        if len(set(self.variants)) < len(self.variants):
            raise invalid(("variants",), "lists the same value twice")
        return self

    @property
    def name(self) -> str:
        """What columns of files call it."""
        return "variant" if self.variants else self.key

    def place(self, variant: str) -> float:
        """Where a variant is."""
        return float(self.variants.index(variant) + 1)

    def text(self, place: float) -> str:
        """A place on it, such as `3`, or the name of a variant."""
        if self.variants and place - 1 in range(len(self.variants)):
            return self.variants[int(place) - 1]
        return place_text(place)


class Quick(Section):
    """What `--quick` leaves of the study."""

    #: The values of the axis, of variants their names; null for all.
    axis: Annotated[tuple[float | Words, ...], Field(min_length=1, strict=False)] | None = None
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
    #: Dotted keys over every scenario in place of those of variants and grid, for the world in
    #: which `ppo` is trained; null trains it where it is evaluated.
    trained_with: Settings | None = None
    #: Values of dotted keys, every combination of which is a cell.
    grid: dict[str, list[Any]] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _check(self) -> Group:
        for i, policy in enumerate(self.policies):
            # One of MODULE:NAME is looked for among those that the command line names.
            if policy not in POLICIES and ":" not in policy:
                hint = did_you_mean(policy, POLICIES)
                raise invalid(("policies", i), f"unknown policy {policy!r}{hint}")
            if self.trained_with is not None and policy != TRAINED:
                raise invalid(
                    ("policies", i), f"{policy!r} is not trained, as trained_with asks for"
                )
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
    def _variants_are_on_the_axis(self) -> Study:
        for name, group in self.groups.items():
            for variant in group.variants if self.axis.variants else ():
                if variant not in self.axis.variants:
                    hint = did_you_mean(variant, self.axis.variants)
                    raise invalid(
                        ("groups", name, "variants"), f"{variant!r} is not in axis.variants{hint}"
                    )
        return self

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
    file = find_study(source)
    layer = read_file(file)
    if "groups" not in layer.data and is_scenario(layer):
        raise InputError(f"{show_file(file)}: is a scenario, not a study")
    return validate(Study, layer), layer
