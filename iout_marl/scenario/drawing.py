"""Draws scenarios of the families that a training goes over, see `training.over`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np

from iout_marl.errors import InputError
from iout_marl.scenario.bases import NOT_OF_FAMILIES
from iout_marl.scenario.data_files import data_files
from iout_marl.scenario.hints import hint_to_dotted_key
from iout_marl.scenario.keys import all_keys, takes_whole_numbers
from iout_marl.scenario.layers import Layer, overrides_layer
from iout_marl.scenario.over import Choices, ForEachNode, Range, Variation, Varied
from iout_marl.scenario.places import Places, show_path
from iout_marl.scenario.problems import validate
from iout_marl.scenario.schema import Scenario

#: Sections of the scenario that is trained, whatever is drawn.
SHARED = ("training", "observation")
#: Keys that no draw changes.
_FIXED = (*NOT_OF_FAMILIES, "allow_implausible")
#: Draws that do not go together (more nodes than cells, say), after which drawing is given up.
_MOST_TRIALS = 1000
#: The key whose values are drawn from by halves, see `ScenarioFamily.strata`.
_STRATIFIED = "nodes.count"


@dataclass(frozen=True)
class Draw:
    """A scenario that was drawn.

    Attributes:
        family: the place of its family in `training.over`, from 0.
        name: of its family.
        stratum: of its family, from 0.
        scenario: with the observation and the training of the scenario that is trained, without
            `training.over`.
        values: what was drawn, by key.
    """

    family: int
    name: str
    stratum: int
    scenario: Scenario
    values: dict[str, Any]


@dataclass(frozen=True)
class ScenarioFamily:
    """One entry of `training.over`.

    Attributes:
        name: what it is called.
        weight: how often it is drawn, relative to the others.
        base: the scenario that all draws have in common.
        variations: what is drawn, by key.
    """

    name: str
    weight: float
    base: Scenario
    variations: dict[str, Variation]

    @property
    def strata(self) -> int:
        """Parts that can be drawn from: both halves of what is drawn of `nodes.count`, else all."""
        counts = self.variations.get(_STRATIFIED)
        return 2 if isinstance(counts, Range | Choices) and len(counts.ends) > 1 else 1

    def draw_values(self, rng: np.random.Generator, stratum: int | None = None) -> dict[str, Any]:
        """Values of all keys; null for lists with a number for each node."""
        values: dict[str, Any] = {}
        for key, variation in self.variations.items():
            if isinstance(variation, ForEachNode):
                values[key] = None
                continue
            share = rng.random()
            if key == _STRATIFIED and stratum is not None:
                share = (stratum + share) / self.strata
            values[key] = variation.at(share, whole=takes_whole_numbers(Scenario, key))
        return values

    def scenario(self, values: dict[str, Any]) -> Scenario:
        """The member with these values.

        Raises:
            InputError: they do not go together.
        """
        if not values:
            return self.base
        layer = overrides_layer(values).over(Layer(self.base.model_dump(), Places(self.base.name)))
        return validate(Scenario, layer)

    def draw(
        self, rng: np.random.Generator, stratum: int | None = None
    ) -> tuple[Scenario, dict[str, Any]]:
        """A member, and the values that it was made by; those that do not go together are not."""
        for _ in range(_MOST_TRIALS):
            try:
                values = self.draw_values(rng, stratum)
                scenario = self.scenario(values)
                lists = {
                    key: [
                        each.numbers.at(u, whole=False)
                        for u in rng.random(scenario.num_nodes).tolist()
                    ]
                    for key, each in self.variations.items()
                    if isinstance(each, ForEachNode)
                }
                return (self.scenario(values | lists) if lists else scenario), values | lists
            except InputError as error:
                last = error
        raise InputError(f"training.over: {self.name}: {_MOST_TRIALS:,} draws in vain: {last}")

    def ends(self) -> Iterator[tuple[str, tuple[str | int, ...], Any]]:
        """Each key with each value at the ends of what is drawn, and where that is written."""
        for key, variation in self.variations.items():
            if isinstance(variation, Choices):
                for i, value in enumerate(variation.ends):
                    yield key, (i,), value
            elif isinstance(variation, Range):
                for name, value in zip(("from", "to"), variation.ends, strict=False):
                    yield key, (name,), value
            else:
                for name, value in zip(("from", "to"), variation.numbers.ends, strict=False):
                    yield key, ("each", name), [value] * self.base.num_nodes


class Families:
    """What a training goes over: families of scenarios, drawn by their weights.

        families = Families.from_scenario(load_scenario("mine.yaml"))
        draw = families.draw(np.random.default_rng(7))

    Attributes:
        members: the families, in the order of `training.over`.
    """

    def __init__(self, members: Sequence[ScenarioFamily]) -> None:
        self.members = tuple(members)

    @classmethod
    def from_scenario(cls, scenario: Scenario) -> Self:
        """Those of a scenario's `training.over`; without it, the scenario alone.

        Raises:
            InputError: a scenario that it has by keys is none.
        """
        alone = scenario.model_copy(
            update={
                "training": scenario.training.model_copy(update={"over": (), "curriculum": "none"})
            }
        )
        found = [
            ScenarioFamily(
                entry.name or str(i), entry.weight, _base(entry, alone, i), entry.variations
            )
            for i, entry in enumerate(scenario.training.over)
        ]
        return cls(found or [ScenarioFamily(scenario.name, 1.0, alone, {})])

    @cached_property
    def weights(self) -> list[float]:
        """How often each family is drawn: shares of 1."""
        total = math.fsum(member.weight for member in self.members)
        return [member.weight / total for member in self.members]

    def draw(
        self,
        rng: np.random.Generator,
        *,
        family: int | None = None,
        stratum: int | None = None,
    ) -> Draw:
        """A scenario; the same numbers of the generator lead to the same one.

        Args:
            rng: where numbers come from.
            family: which; None for one drawn by the weights.
            stratum: of that family, see `ScenarioFamily.strata`; None for any.

        Raises:
            InputError: what is drawn never goes together.
        """
        if family is None:
            family = int(rng.choice(len(self.members), p=self.weights))
        member = self.members[family]
        if stratum is None:
            stratum = int(rng.integers(member.strata))
        scenario, values = member.draw(rng, stratum)
        return Draw(family, member.name, stratum, scenario, values)


def check_families(scenario: Scenario, layer: Layer) -> None:
    """See that all that `training.over` draws can be.

    Args:
        scenario: the scenario.
        layer: where it is written.

    Raises:
        InputError: there is no such key, a draw is no scenario, or needs a file of data of its own.
    """
    for i, entry in enumerate(scenario.training.over):
        path: tuple[str | int, ...] = ("training", "over", i)
        for key in entry.vary:
            _check_key(key, (*path, "vary", key), layer)
    families = Families.from_scenario(scenario)
    own_files = set(data_files(scenario))
    for i, family in enumerate(families.members if scenario.training.over else ()):
        path = ("training", "over", i)
        _check_files(family.base, own_files, (*path, "scenario"), layer)
        for key, inside, value in family.ends():
            place = (*path, "vary", key, *inside)
            try:
                drawn = family.scenario({key: value})
            except InputError as error:
                message = str(error).removeprefix(f"override {key}: ")
                raise _at(place, message, layer) from None
            _check_files(drawn, own_files, place, layer)


def _base(entry: Varied, alone: Scenario, i: int) -> Scenario:
    if entry.scenario is None:
        return alone
    own = {key: value for key, value in entry.scenario.items() if key not in NOT_OF_FAMILIES}
    shared = {key: getattr(alone, key).model_dump() for key in SHARED}
    name = entry.name or str(i)
    try:
        return validate(Scenario, Layer({"name": name, **own, **shared}, Places(name)))
    except InputError as error:
        raise InputError(f"training.over[{i}].scenario: {error}") from None


def _check_key(key: str, path: tuple[str | int, ...], layer: Layer) -> None:
    if key not in all_keys(Scenario):
        raise _at(path, f"unknown key{hint_to_dotted_key(Scenario, key)}", layer)
    if key.partition(".")[0] in _FIXED:
        raise _at(path, "cannot be drawn: it is the same for all that a training goes over", layer)


def _check_files(drawn: Scenario, own: set[Any], path: tuple[str | int, ...], layer: Layer) -> None:
    other = [file.path for file in data_files(drawn) if file not in own]
    if other:
        raise _at(
            path,
            f"reads {other[0]}: of files of data only those that the scenario itself reads can be "
            "drawn",
            layer,
        )


def _at(path: tuple[str | int, ...], message: str, layer: Layer) -> InputError:
    return InputError(f"{layer.origin(path)}: {show_path(path)}: {message}")
