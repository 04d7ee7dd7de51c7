"""Families: one file for all scenarios that are the product of a few choices.

    extends: paper/k10-{duplex}         # axes may be filled in here,
    description: "{nodes.count} nodes"  # and in `name` and `description`
    matrix:
      name: k{nodes.count}-{duplex}     # k3-fdd, k3-tdd, k5-fdd, k5-tdd
      axes:
        nodes.count: [3, 5]             # values of a key of the scenario,
        duplex: {fdd: {}, tdd: {duplex.beta_rule: stored}}  # or settings, by names of one's own

What else the file says is shared by all members. Each member is the file over what it extends,
under the settings of its value of every axis, in the order of the axes, under those of the
cases that hold.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, field_validator

from iout_marl.errors import InputError, did_you_mean
from iout_marl.scenario.cases import cases_that_hold, checked_cases
from iout_marl.scenario.fields import Section, Text, invalid
from iout_marl.scenario.layers import Layer, settings_layer
from iout_marl.scenario.placeholders import fill_placeholders, placeholders, word_of
from iout_marl.scenario.places import Places, shorten, show_file, show_path, show_value
from iout_marl.scenario.problems import refuse_unknown, validate
from iout_marl.scenario.schema import Scenario
from iout_marl.words import listed

#: More members than a family has.
MAX_MEMBERS = 1_000
#: Names of members are parts of paths: no blanks, no slashes.
_NAME = re.compile(r"[^\W_][\w.+-]*")
#: Texts of a member in which axes are filled in.
_FILLED = ("name", "description")


def _check_settings(path: tuple[str | int, ...], settings: object) -> None:
    if not isinstance(settings, dict):
        given = show_value(settings)
        raise invalid(path, f"must be a mapping of settings, {{}} for none, not {given}")
    for key in ("extends", "matrix"):
        if key in settings:
            also = ", where {axis} is filled in" if key == "extends" else ""
            raise invalid((*path, key), f"{key} stands at the top of a file{also}")


class Matrix(Section):
    """What makes a file a family: every combination of one value of each axis is a scenario."""

    #: Names the members, `{axis}` filled in; null for all values with hyphens between them.
    name: Text | None = None
    #: An axis that is called as a key of the scenario lists values of it. Any other gives each of
    #: its values a name and settings, by dotted keys or in sections.
    axes: Annotated[dict[str, Any], Field(min_length=1)]
    #: Names of combinations that are no members.
    without: Annotated[tuple[str, ...], Field(strict=False)] = ()
    #: Settings of some members only, a list of `{when: {axis or key: value}, set: {…}}`: of each
    #: whose conditions all hold, over those of the axes.
    cases: list[Any] = Field([])

    @field_validator("axes")
    @classmethod
    def _have_named_values(cls, axes: dict[str, Any]) -> dict[str, Any]:
        for axis, values in axes.items():
            if isinstance(values, list):
                words: set[str] = set()
                for i, value in enumerate(values):
                    if isinstance(value, list | dict):
                        message = f"{show_value(value)} has no name; write {axis}: {{NAME: {{…}}}}"
                        raise invalid((axis, i), message)
                    if word_of(value) in words:
                        raise invalid((axis, i), f"lists {shorten(word_of(value))} twice")
                    words.add(word_of(value))
            elif isinstance(values, dict):
                for name, settings in values.items():
                    _check_settings((axis, name), settings)
            else:
                message = "must list values of a key, or name values and give their settings"
                raise invalid((axis,), f"{message}, not {show_value(values)}")
            if not values:
                raise invalid((axis,), "has no values: give at least one")
        return axes

    @field_validator("cases")
    @classmethod
    def _set_settings(cls, cases: list[Any]) -> list[Any]:
        for i, case in enumerate(cases):
            if isinstance(case, dict) and "set" in case:
                _check_settings((i, "set"), case["set"])
        return cases


class _FamilyFile(Section):
    """What makes a file that of a family."""

    matrix: Matrix


@dataclass(frozen=True)
class Family:
    """A family.

    Attributes:
        file: where it is written.
        own: what its members share, beside what they extend.
        settings: those of each axis, by the name of the value.
        members: for the name of every member, that of its value of each axis.
        matrix: the layer of `matrix`.
    """

    file: Path
    own: Layer
    settings: Mapping[str, Mapping[str, Layer]]
    members: Mapping[str, Mapping[str, str]]
    matrix: Layer

    def member(self, name: str) -> Member:
        """The member of that name.

        Raises:
            InputError: there is none.
        """
        if name not in self.members:
            raise InputError(self.no_member(name))
        return Member(self, name)

    def no_member(self, name: str) -> str:
        """What is said of a name that no member has, or of none."""
        file = show_file(self.file)
        if not name:
            known = ", ".join(f"{self.file.stem}/{member}" for member in self.members)
            return f"{file}: is a family, name one of its scenarios: {known}"
        return f"{file}: no member {show_value(name)}{did_you_mean(shorten(name), self.members)}"


@dataclass(frozen=True)
class Member:
    """A scenario of a family."""

    family: Family
    name: str

    @property
    def axes(self) -> Mapping[str, str]:
        """The name of its value of each axis."""
        return self.family.members[self.name]

    def over(self, bases: Layer) -> Layer:
        """Its settings over those of what it extends.

        Raises:
            InputError: a placeholder that is no axis, a case that is none.
        """
        whole = self.filled(self.family.own).over(bases)
        for axis, value in self.axes.items():
            whole = self.filled(self.family.settings[axis][value]).over(whole)
        cases = cases_that_hold(self.family.matrix, whole.data, self.axes)
        for layer in [settings_layer(*case) for case in cases]:
            whole = self.filled(layer).over(whole)
        return whole

    def fill(self, text: str, where: str, key: str) -> str:
        """A text of the family's with the values of axes in the place of `{axis}`.

        Raises:
            InputError: a placeholder that is no axis.
        """
        return fill_placeholders(text, self.axes, f"{where}: {key}")

    def filled(self, layer: Layer) -> Layer:
        """A layer with its texts filled in.

        Raises:
            InputError: as by `fill`.
        """
        texts = {
            key: self.fill(layer.data[key], layer.origin((key,)), key)
            for key in _FILLED
            if isinstance(layer.data.get(key), str)
        }
        return Layer({**layer.data, **texts}, layer.places)


def family_of(layer: Layer, file: Path) -> Family | None:
    """The family that a file describes; None where it has no `matrix`.

    Raises:
        InputError: one line with file, line, key and what was meant.
    """
    if "matrix" not in layer.data:
        return None
    places = layer.places.inside["matrix"]
    matrix = Layer(layer.data["matrix"], places)
    checked = validate(_FamilyFile, matrix.below("matrix")).matrix
    own = {key: value for key, value in layer.data.items() if key not in ("extends", "matrix")}
    settings = {
        axis: dict(_settings(axis, values, places.inside["axes"].inside[axis]))
        for axis, values in checked.axes.items()
    }
    members = _members(checked, matrix, settings)
    _check_conditions(matrix, settings)
    family = Family(file, Layer(own, layer.places), settings, members, matrix)
    _check_members(family, layer)
    return family


def _settings(axis: str, values: Any, places: Places) -> Iterator[tuple[str, Layer]]:
    """The names of an axis's values with their settings."""
    if isinstance(values, dict):
        for name, settings in values.items():
            yield name, settings_layer(settings, places.inside[name])
    else:
        for i, value in enumerate(values):
            item = Places(inside={axis: places.inside[i]})
            yield word_of(value), settings_layer({axis: value}, item)


def _members(
    checked: Matrix, matrix: Layer, settings: Mapping[str, Mapping[str, Layer]]
) -> dict[str, dict[str, str]]:
    """The value of each axis for every member, by its name."""

    def refuse(path: tuple[str | int, ...], message: str) -> InputError:
        return InputError(f"{matrix.origin(path)}: {show_path(('matrix', *path))}: {message}")

    if math.prod(map(len, settings.values())) > MAX_MEMBERS:
        raise refuse(("axes",), f"make more than {MAX_MEMBERS:,} members")
    pattern = "-".join(f"{{{axis}}}" for axis in settings) if checked.name is None else checked.name
    where = f"{matrix.origin(('name',))}: matrix.name"
    members: dict[str, dict[str, str]] = {}
    for values in itertools.product(*settings.values()):
        axes = dict(zip(settings, values, strict=True))
        name = fill_placeholders(pattern, axes, where)
        if not _NAME.fullmatch(name):
            rule = "a name has letters, digits and . + - _ only, and begins with one of the first"
            raise refuse(("name",), f"makes {show_value(name)}: {rule}")
        if name in members:
            missing = [f"{{{axis}}}" for axis in settings if axis not in placeholders(pattern)]
            tell = f"; tell them apart by {listed(missing)}" if missing else ""
            raise refuse(("name",), f"two members are called {show_value(name)}{tell}")
        members[name] = axes
    for i, name in enumerate(checked.without):
        if name not in members:
            hint = did_you_mean(shorten(name), members)
            raise refuse(("without", i), f"no member {show_value(name)}{hint}")
    left = {name: axes for name, axes in members.items() if name not in checked.without}
    if not left:
        raise refuse(("without",), "leaves no member")
    return left


def _check_members(family: Family, layer: Layer) -> None:
    """Refuse what no member can have: unknown keys, and placeholders that are no axes.

    `layer` is the whole file.
    """
    member = Member(family, next(iter(family.members)))
    bases = layer.data.get("extends")
    for base in [bases] if isinstance(bases, str) else bases or []:
        if isinstance(base, str):
            member.fill(base, layer.origin(("extends",)), "extends")
    cases = checked_cases(family.matrix, family.settings)
    for part in (
        family.own,
        *(value for values in family.settings.values() for value in values.values()),
        *(settings_layer(case["set"], places.inside["set"]) for case, places in cases),
    ):
        refuse_unknown(Scenario, member.filled(part))


def _check_conditions(matrix: Layer, settings: Mapping[str, Mapping[str, Layer]]) -> None:
    """Refuse conditions on an axis that none of its values meets."""
    for i, case in enumerate(matrix.data.get("cases", [])):
        conditions = case.get("when") if isinstance(case, dict) else None
        for axis, value in (conditions if isinstance(conditions, dict) else {}).items():
            if axis in settings and word_of(value) not in settings[axis]:
                hint = did_you_mean(shorten(word_of(value)), settings[axis])
                where = matrix.origin(("cases", i, "when", axis))
                raise InputError(
                    f"{where}: cases: when: {axis}: unknown value {show_value(value)}{hint}"
                )
