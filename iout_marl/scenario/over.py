"""What a policy is trained over: families of scenarios, as `training.over` writes them.

over:
  - multi/m2-k10-fdd                  # a scenario as it is
  - name: small                       # the scenario with this section, but for what varies
    weight: 2
    vary:
      nodes.count: {from: 3, to: 30}  # whole numbers, as the key takes them
      charging.power_w: {from: 5, to: 50, scale: log}
      grid.cells: [[6, 6, 2], [10, 10, 3]]
      nodes.weights: {each: {from: 0.5, to: 2}}  # a number for each node
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, TypeAlias

from pydantic import Field, model_validator

from iout_marl.errors import did_you_mean
from iout_marl.scenario.fields import Positive, Section, Text, invalid
from iout_marl.scenario.places import show_value

_SCALES = ("linear", "log")


@dataclass(frozen=True)
class Range:
    """Numbers between two ends, both included; whole ones where the key takes whole numbers."""

    low: float
    high: float
    is_log: bool

    @property
    def ends(self) -> tuple[float, ...]:
        """What has to be possible for all in between to be."""
        return (self.low, self.high) if self.high > self.low else (self.low,)

    def at(self, share: float, *, whole: bool) -> float:
        """The number below which lies a share, 0 to below 1, of what is drawn."""
        low, high = self.low, self.high + (1 if whole else 0)
        number = low * (high / low) ** share if self.is_log else low + share * (high - low)
        return min(math.floor(number), int(self.high)) if whole else min(number, self.high)


@dataclass(frozen=True)
class Choices:
    """Values of which each is drawn equally often."""

    ends: tuple[Any, ...]

    def at(self, share: float, *, whole: bool) -> Any:  # noqa: ARG002
        """The value at a share, 0 to below 1, of the list."""
        return self.ends[int(share * len(self.ends))]


@dataclass(frozen=True)
class ForEachNode:
    """A list with a number of the range for each node."""

    numbers: Range


Variation: TypeAlias = Range | Choices | ForEachNode


def variation(written: Any, path: tuple[str | int, ...] = ()) -> Variation:
    """What a key's `vary` says.

    Raises:
        PydanticCustomError: it says none, at `path` or below.
    """
    if isinstance(written, Sequence) and not isinstance(written, str):
        if not written:
            raise invalid(path, "must list at least one value")
        return Choices(tuple(written))
    if not isinstance(written, Mapping):
        raise invalid(
            path, f"must be a list of choices or {{from: …, to: …}}, not {show_value(written)}"
        )
    if "each" in written:
        _refuse_unknown(written, ("each",), path)
        inner = variation(written["each"], (*path, "each"))
        if not isinstance(inner, Range):
            raise invalid((*path, "each"), "must be {from: …, to: …}")
        return ForEachNode(inner)
    _refuse_unknown(written, ("from", "to", "scale"), path)
    ends = []
    for name in ("from", "to"):
        if name not in written:
            raise invalid((*path, name), "is missing")
        number = written[name]
        if isinstance(number, bool) or not isinstance(number, int | float):
            raise invalid((*path, name), f"must be a number, not {show_value(number)}")
        if not abs(number) < math.inf:
            raise invalid((*path, name), f"must be a finite number, not {number}")
        ends.append(number)
    scale = written.get("scale", "linear")
    if scale not in _SCALES:
        near = did_you_mean(scale, _SCALES) if isinstance(scale, str) else ""
        raise invalid((*path, "scale"), f"must be linear or log, not {show_value(scale)}{near}")
    low, high = ends
    if low > high:
        raise invalid((*path, "to"), f"must not lie below from, {low:g}, as {high:g} does")
    if scale == "log" and low <= 0:
        raise invalid((*path, "from"), f"must be above 0 for scale: log, not {low:g}")
    return Range(low, high, scale == "log")


def _refuse_unknown(
    written: Mapping[Any, Any], known: Sequence[str], path: tuple[str | int, ...] = ()
) -> None:
    for key in written:
        if key not in known:
            raise invalid((*path, str(key)), f"unknown key{did_you_mean(str(key), known)}")


class Varied(Section):
    """A scenario, or a family of them of which one after the other is drawn."""

    #: What it is called in logs; by default as its scenario, or by its place in the list.
    name: Text = ""
    #: A scenario's name or path, or its keys; null for the scenario that has this section. Of
    #: another one, its observation, training, name and description do not count.
    scenario: dict[str, Any] | None = None
    #: What is drawn, by dotted keys of the scenario: `{from: …, to: …}`, with `scale: log` where
    #: wanted; a list of choices; or `{each: {from: …, to: …}}` for lists with a number for each
    #: node.
    vary: dict[str, Any] = Field({})
    #: How often it is drawn, relative to the others.
    weight: Annotated[Positive, Field(le=1e9)] = 1.0

    @model_validator(mode="before")
    @classmethod
    def _check_keys(cls, data: Any) -> Any:
        if isinstance(data, Mapping):
            _refuse_unknown(data, tuple(cls.model_fields))
        return data

    @model_validator(mode="after")
    def _check_variations(self) -> Varied:
        for key, written in self.vary.items():
            variation(written, ("vary", key))
        return self

    @property
    def variations(self) -> dict[str, Variation]:
        """What is drawn, by key."""
        return {key: variation(written) for key, written in self.vary.items()}
